"""`imocap run` and `stage`: run what has changed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from imocap_core.cli.json_output import print_json
from imocap_core.cli.options import (
    ActionName,
    Device,
    Json,
    Sets,
    SharedStore,
    StageName,
    Verbose,
    action_names,
    ask_about_scripts,
    counted,
    root_of,
    shortened,
    speaker,
    stage_names,
)
from imocap_core.errors import ImocapError, WrongUse

if TYPE_CHECKING:
    from rich.console import Console

    from imocap_core.library.progress import Progress
    from imocap_core.library.running import Run
    from imocap_core.verdict.findings import Verdict

Force = Annotated[bool, typer.Option("--force", help="Run cached stages too.")]


def run_command(
    context: typer.Context,
    words: Annotated[
        list[str],
        typer.Argument(
            metavar="ACTION | VIDEO... | FOLDER",
            help="A name below actions/, an action's folder, or videos or their folder.",
            autocompletion=action_names,
        ),
    ],
    name: Annotated[str | None, typer.Option(help="Of the action that is made of videos.")] = None,
    force: Force = False,
    sets: Sets = [],  # noqa: B006
    until: Annotated[
        str | None, typer.Option(help="Stop after this stage.", autocompletion=stage_names)
    ] = None,
    store: SharedStore = None,
    device: Device = "cpu",
    watch: Annotated[
        bool, typer.Option("--watch", help="Of one folder: run again when clips come or go.")
    ] = False,
    verbose: Verbose = False,
    as_json: Json = False,
) -> None:
    """Run an action: all stages that have changed, and the report."""
    from imocap_core.library.new_action import action_of_words
    from imocap_core.library.running import run_action
    from imocap_core.library.terminal import Terminal
    from imocap_core.pipeline.device import check_device

    check_device(device)  # before an action is made of videos
    if watch:
        if as_json or len(words) != 1 or not Path(words[0]).is_dir():
            raise WrongUse("--watch: expected one folder of videos, and no --json")
        ask_about_scripts(context)
        options = {"params": sets, "until": until, "store": store, "device": device}
        _watch(root_of(context), Path(words[0]), name, verbose, options)
    action, remarks = action_of_words(root_of(context), words, name)

    def solve(progress: Progress) -> Run:
        return run_action(
            action,
            root=root_of(context),
            params=sets,
            force=force,
            until=until,
            store=store,
            device=device,
            progress=progress,
        )

    if as_json:
        from imocap_core.library.run_document import run_document

        done = solve(None)
        print_json(run_document(replace(done, notes=[*remarks, *done.notes])))
        return
    ask_about_scripts(context)
    console = speaker()
    for remark in remarks if verbose else shortened(remarks):
        speaker(markup=False).print(remark)
    with Terminal(console, verbose=verbose) as display:
        done = solve(display)
    _print_summary(console, done, verbose)


def _watch(
    root: Path, folder: Path, name: str | None, verbose: bool, options: dict[str, Any]
) -> None:
    """Run the action of a folder whenever its videos have changed, until Ctrl-C."""
    from imocap_core.library import watching
    from imocap_core.library.running import run_action
    from imocap_core.library.terminal import Terminal

    console, plain = speaker(), speaker(markup=False)
    plain.print(f"Watching {folder}; Ctrl-C ends it.")
    for _ in watching.settled_changes(folder):
        try:
            update = watching.bring_up_to_date(root, folder, name)
            name = update.action
            before = watching.last_result(root, name)
            with Terminal(console, verbose=verbose) as display:
                done = run_action(name, root=root, progress=display, **options)
            _print_summary(console, done, verbose)
            if (after := watching.last_result(root, name)) is not None:
                plain.print(watching.compared(update, before, after))
                watching.record(root, update, before, after)
        except ImocapError as error:  # too few clips yet, or a bad one: others may come
            plain.print(str(error))


def stage_command(
    context: typer.Context,
    name: StageName,
    action: ActionName,
    force: Force = False,
    sets: Sets = [],  # noqa: B006
    device: Device = "cpu",
    verbose: Verbose = False,
) -> None:
    """Run one stage, and the stages it needs unless they are cached."""
    from imocap_core.library.running import run_stage
    from imocap_core.library.terminal import Terminal

    ask_about_scripts(context)
    console = speaker()
    with Terminal(console, verbose=verbose) as display:
        done = run_stage(
            name,
            action,
            root=root_of(context),
            params=sets,
            force=force,
            device=device,
            progress=display,
        )
    _print_summary(console, done, verbose)


def _print_summary(console: Console, done: Run, verbose: bool) -> None:
    from rich.markup import escape

    from imocap_core.library.report_page import report_page

    for note in done.notes if verbose else shortened(done.notes):
        console.print(escape(note))
    outcomes = done.outcomes
    made = sum(outcome.how == "made" for outcome in outcomes)
    how = f"{made} made, {len(outcomes) - made} cached" if made else "all cached"
    page = report_page(done.job)
    count = 0 if done.verdict is None else len(warnings_of(done.verdict))
    inside = f", with {counted(count, 'warning')}" if count else ""
    end = f" Report{inside}: {page}" if page and outcomes[-1].stored.has_files else ""
    name = done.job.action.name
    console.print(
        escape(f"{name}: {counted(len(outcomes), 'stage')}, {how}, {done.seconds:.1f} s.{end}")
    )
    if done.verdict is not None:
        for line in terminal_lines(done.verdict, verbose):
            console.print(escape(line))


def terminal_lines(verdict: Verdict, verbose: bool = False) -> list[str]:
    """The three sentences; verbose: all warnings before them. The report has these too."""
    warnings = [f"* {sentence}" for sentence in warnings_of(verdict)] if verbose else []
    return [*warnings, *verdict.summary]


def warnings_of(verdict: Verdict) -> list[str]:
    """What to know beside the three sentences."""
    return [finding.sentence for finding in verdict.findings if finding.kind != "joints"]

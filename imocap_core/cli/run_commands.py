"""`imocap run`, `stage`, `run-all`, `status`, `explain`: run what has changed, and why."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from imocap_core.cli.options import (
    ActionName,
    Device,
    Json,
    Sets,
    StageName,
    Verbose,
    action_names,
    ask_about_scripts,
    counted,
    print_json,
    progress_on,
    root_of,
    shortened,
    speaker,
    stage_names,
)
from imocap_core.errors import WrongUse

if TYPE_CHECKING:
    from rich.console import Console

    from imocap_core.diagnostics.findings import Verdict
    from imocap_core.library.run_all import ActionEnd
    from imocap_core.library.running import Run


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
    device: Device = "cpu",
    verbose: Verbose = False,
    as_json: Json = False,
) -> None:
    """Run an action: all stages that have changed, and the report."""
    from imocap_core.library.new_action import action_of_words
    from imocap_core.library.running import run_action
    from imocap_core.process import check_device

    check_device(device)  # before an action is made of videos
    action, remarks = action_of_words(root_of(context), words, name)
    console = speaker()
    if not as_json:
        ask_about_scripts(context)
        for remark in remarks if verbose else shortened(remarks):
            speaker(markup=False).print(remark)
    with progress_on(console, as_json, verbose) as display:
        done = run_action(
            action,
            root=root_of(context),
            params=sets,
            force=force,
            until=until,
            device=device,
            progress=display,
        )
    if as_json:
        from imocap_core.library.run_document import run_document

        print_json(run_document(replace(done, notes=[*remarks, *done.notes])))
    else:
        _print_summary(console, done, verbose)


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

    ask_about_scripts(context)
    console = speaker()
    with progress_on(console, verbose=verbose) as display:
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

    from imocap_core.library.status import report_page

    for note in done.notes if verbose else shortened(done.notes):
        console.print(escape(note))
    outcomes = done.outcomes
    made = sum(outcome.how == "made" for outcome in outcomes)
    how = f"{made} made, {len(outcomes) - made} cached" if made else "all cached"
    page = report_page(done.job)
    count = 0 if done.verdict is None else len(warnings_of(done.verdict))
    word = "remark" if done.verdict is not None and done.verdict.trusted else "warning"
    inside = f", with {counted(count, word)}" if count else ""
    end = f" Report{inside}: {page}" if page and outcomes[-1].stored.has_files else ""
    name = done.job.action.name
    console.print(
        escape(f"{name}: {counted(len(outcomes), 'stage')}, {how}, {done.seconds:.1f} s.{end}")
    )
    if done.verdict is not None:
        for line in terminal_lines(done.verdict, verbose):
            console.print(escape(line))
    if end:
        console.print(escape(f"See it in 3D: imocap view {name} --open"))


def terminal_lines(verdict: Verdict, verbose: bool = False) -> list[str]:
    """The three sentences; verbose: all warnings before them. The report has these too."""
    warnings = [f"* {sentence}" for sentence in warnings_of(verdict)] if verbose else []
    return [*warnings, *verdict.summary]


def warnings_of(verdict: Verdict) -> list[str]:
    """What to know beside the three sentences."""
    return [finding.sentence for finding in verdict.findings if finding.kind != "joints"]


def run_all_command(
    context: typer.Context,
    actions: Annotated[
        list[str] | None,
        typer.Argument(
            help="Names below actions/, or actions' folders.", autocompletion=action_names
        ),
    ] = None,
    every: Annotated[bool, typer.Option("--all", help="Every action below actions/.")] = False,
    executor: Annotated[
        str, typer.Option(help="serial, processes (of this machine) or dask.")
    ] = "processes",
    workers: Annotated[
        int | None, typer.Option(help="Worker processes.", show_default="one a core")
    ] = None,
    address: Annotated[
        str | None, typer.Option(metavar="HOST:PORT", help="A Dask scheduler to use.")
    ] = None,
    retries: Annotated[int, typer.Option(help="Further attempts at a task whose worker died.")] = 1,
    sets: Sets = [],  # noqa: B006
    device: Device = "cpu",
    verbose: Verbose = False,
    as_json: Json = False,
) -> None:
    """Run many actions, several at once, to their reports.

    One that fails stops no other; the exit code is 1 when one did.
    """
    from imocap_core.library.run_all import ExecutorChoice, check_choice, run_all
    from imocap_core.library.run_all_terminal import ManyActions

    if bool(actions) == every:
        raise WrongUse("expected actions, or --all for every one below actions/: one of them")
    choice = ExecutorChoice(executor, workers, address, retries)
    check_choice(choice)
    chosen = None if every else actions
    if as_json:
        ends = run_all(chosen, root=root_of(context), params=sets, executor=choice, device=device)
        print_json({"actions": ends})
    else:
        ask_about_scripts(context)
        console = speaker()
        with ManyActions(console, verbose=verbose) as display:
            ends = run_all(
                chosen,
                root=root_of(context),
                params=sets,
                executor=choice,
                device=device,
                listener=display.listener(),
            )
        _print_summary_of_all(console, ends, verbose)
    if any(end.state == "failed" for end in ends):
        raise typer.Exit(1)


def _print_summary_of_all(console: Console, ends: list[ActionEnd], verbose: bool) -> None:
    from rich.markup import escape

    for end in ends:
        summary = end.stages[-1].summary if end.stages else ()
        if verbose and summary:
            console.print(escape(f"\n{end.action}: " + " ".join(summary)))
    failed = [end for end in ends if end.state == "failed"]
    console.print(
        f"\n{counted(len(ends), 'action')}: {len(ends) - len(failed)} done, {len(failed)} failed."
    )
    for end in failed:
        console.print(escape(f"* {end.action}: {end.fault}"))
    if failed:
        console.print("What was finished is stored; run again to go on.")


MAX_REASONS = 3


def status_command(
    context: typer.Context,
    action: ActionName,
    sets: Sets = [],  # noqa: B006
    as_json: Json = False,
) -> None:
    """Show which stages are cached, and why others would run."""
    from imocap_core.library.status import left_out_notes, left_out_of, status, stored_of, verdict

    stages = status(action, root=root_of(context), params=sets)
    stored = stored_of(stages)
    if as_json:
        rows = [
            {
                "stage": stage.stage,
                "state": stage.state,
                "why": stage.why,
                "digest": None if stage.stored is None else stage.stored.digest,
            }
            for stage in stages
        ]
        judged = verdict(action, root=root_of(context), params=sets)
        names = [
            {"video": video, "reason": reason} for video, reason in left_out_of(stored).items()
        ]
        print_json({"action": action, "stages": rows, "left_out": names, "verdict": judged})
        return
    from rich.markup import escape

    console = speaker()
    for stage in stages:
        if stage.stored is not None:
            state = f"[dim]cached     {stage.stored.digest[:12]}[/]"
        else:
            state = f"would run  {escape(reasons(stage.why))}"
        console.print(f"{stage.stage:<14} {state}")
    for note in left_out_notes(stored):
        console.print(escape(note))


def explain_command(
    context: typer.Context,
    action: ActionName,
    stage: StageName,
    sets: Sets = [],  # noqa: B006
    as_json: Json = False,
) -> None:
    """Show all that a stage's result depends on, and what changed."""
    from imocap_core.library.status import explain

    explanation = explain(action, stage, root=root_of(context), params=sets)
    status, recipe = explanation.status, explanation.recipe
    if as_json:
        document: dict[str, Any] = {
            "action": action,
            "stage": stage,
            "state": status.state,
            "why": status.why,
        }
        document["missing"] = explanation.missing
        if recipe is not None:
            fields = ("key", "seed", "inputs", "reads", "code", "params")
            document |= {field: getattr(recipe, field) for field in fields}
        print_json(document)
        return
    console = speaker(markup=False)
    console.print(f"{stage}: {status.state}")
    if recipe is None:
        console.print(f"  after {', '.join(explanation.missing)}")
        return
    for why in status.why:
        console.print(f"  because {why}")
    console.print(f"key     {recipe.key}\nseed    {recipe.seed}")
    for title, leaves in (("input", recipe.inputs), ("read", recipe.reads), ("code", recipe.code)):
        for name, digest in leaves.items():
            console.print(f"{title:<7} {digest[:12]}  {name}")
    for group, values in recipe.params.items():
        for name, value in values.items():
            console.print(f"param   {group}.{name} = {value}")


def reasons(why: list[str]) -> str:
    """The first few reasons, and how many more there are."""
    more = len(why) - MAX_REASONS
    return "; ".join(why[:MAX_REASONS]) + (f"; and {more} more" if more > 0 else "")

"""`imocap run-all`: many actions, on every core or on a cluster."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from imocap_core.cli.json_output import print_json
from imocap_core.cli.options import (
    Device,
    Json,
    Sets,
    SharedStore,
    Verbose,
    action_names,
    ask_about_scripts,
    counted,
    root_of,
    speaker,
)
from imocap_core.errors import WrongUse

if TYPE_CHECKING:
    from rich.console import Console

    from imocap_core.library.run_all import ActionEnd


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
    memory: Annotated[
        str | None, typer.Option(metavar="SIZE", help="Largest memory of a worker, as 4G.")
    ] = None,
    retries: Annotated[int, typer.Option(help="Further attempts at a task whose worker died.")] = 1,
    sets: Sets = [],  # noqa: B006
    store: SharedStore = None,
    device: Device = "cpu",
    verbose: Verbose = False,
    as_json: Json = False,
) -> None:
    """Run many actions, several at once, to their reports.

    One that fails stops no other; the exit code is 1 when one did.
    """
    from imocap_core.library.run_all import ExecutorChoice, check_choice, run_all
    from imocap_core.library.run_all_terminal import ManyActions
    from imocap_core.memory_limit import memory_size

    if bool(actions) == every:
        raise WrongUse("expected actions, or --all for every one below actions/: one of them")
    limit = None if memory is None else memory_size(memory)
    choice = ExecutorChoice(executor, workers, address, limit, retries)
    check_choice(choice)
    chosen = None if every else actions
    if as_json:
        ends = run_all(
            chosen,
            root=root_of(context),
            params=sets,
            executor=choice,
            store=store,
            device=device,
        )
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
                store=store,
                device=device,
                listener=display.listener(),
            )
        _print_summary(console, ends, verbose)
    if any(end.state == "failed" for end in ends):
        raise typer.Exit(1)


def _print_summary(console: Console, ends: list[ActionEnd], verbose: bool) -> None:
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

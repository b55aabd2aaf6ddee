"""`imocap run`, `stage`, `status` and `explain`: what runs, what is cached, and why."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.markup import escape

from imocap_core.cli.options import ActionName, Sets, root_of, speaker
from imocap_core.library.status import explain, status
from imocap_core.library.terminal import Terminal, reasons

if TYPE_CHECKING:
    from imocap_core.library.running import Run

StageName = Annotated[str, typer.Argument(help="A stage of pipeline.yaml.")]
Force = Annotated[bool, typer.Option("--force", help="Run even what is cached.")]


def run_command(
    context: typer.Context,
    action: ActionName,
    force: Force = False,
    sets: Sets = [],  # noqa: B006
    until: Annotated[str | None, typer.Option(help="Stop after this stage.")] = None,
) -> None:
    """Run every stage of an action that has changed, to its report."""
    from imocap_core.library.running import run_action

    console = speaker()
    with Terminal(console) as display:
        done = run_action(
            action,
            root=root_of(context),
            params=sets,
            force=force,
            until=until,
            progress=display,
        )
    _print_summary(console, done)


def stage_command(
    context: typer.Context,
    name: StageName,
    action: ActionName,
    force: Force = False,
    sets: Sets = [],  # noqa: B006
) -> None:
    """Run one stage (and what it needs, where that is not cached)."""
    from imocap_core.library.running import run_stage

    console = speaker()
    with Terminal(console) as display:
        done = run_stage(
            name, action, root=root_of(context), params=sets, force=force, progress=display
        )
    _print_summary(console, done)


def status_command(context: typer.Context, action: ActionName, sets: Sets = []) -> None:  # noqa: B006
    """What is cached, what would run, and why."""
    console = speaker()
    for stage in status(action, root=root_of(context), params=sets):
        if stage.stored is not None:
            state = f"[dim]cached     {stage.stored.digest[:12]}[/]"
        else:
            state = f"would run  {escape(reasons(stage.why))}"
        console.print(f"{stage.stage:<14} {state}")


def explain_command(
    context: typer.Context,
    action: ActionName,
    stage: StageName,
    sets: Sets = [],  # noqa: B006
) -> None:
    """Everything that a stage's result depends on, and what has changed since it was made."""
    console = speaker(markup=False)
    explanation = explain(action, stage, root=root_of(context), params=sets)
    console.print(f"{stage}: {explanation.status.state}")
    recipe = explanation.recipe
    if recipe is None:
        console.print(f"  after {', '.join(explanation.missing)}")
        return
    for why in explanation.status.why:
        console.print(f"  because {why}")
    console.print(f"key     {recipe.key}\nseed    {recipe.seed}")
    for title, leaves in (("input", recipe.inputs), ("read", recipe.reads), ("code", recipe.code)):
        for name, digest in leaves.items():
            console.print(f"{title:<7} {digest[:12]}  {name}")
    for group, values in recipe.params.items():
        for name, value in values.items():
            console.print(f"param   {group}.{name} = {value}")


def _print_summary(console: Console, done: Run) -> None:
    from imocap_core.library.outputs import report_page

    for note in done.notes:
        console.print(escape(note))
    outcomes = done.outcomes
    made = sum(outcome.how == "made" for outcome in outcomes)
    how = f"{made} made, {len(outcomes) - made} cached" if made else "every one cached"
    page = report_page(done.job)
    end = f" Report: {page}" if page and outcomes[-1].stored.content.files else ""
    name = done.job.action.name
    console.print(escape(f"{name}: {len(outcomes)} stages, {how}, {done.seconds:.1f} s.{end}"))

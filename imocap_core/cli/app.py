"""The commands, each a few lines: find the action, call the harness, say what happened."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from imocap_core.cli.benchmark_command import add_benchmarks
from imocap_core.cli.compare_command import compare_command
from imocap_core.cli.detect_command import detect_command
from imocap_core.cli.export_command import export_command
from imocap_core.cli.options import ActionName, Sets, speaker, workspace_of
from imocap_core.cli.people_command import people_command
from imocap_core.cli.report_command import report_command
from imocap_core.cli.show import Terminal, reasons
from imocap_core.cli.sync_command import sync_command
from imocap_core.cli.video_command import video_command
from imocap_core.cli.view_command import report_page, view_command
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.pipeline import runner
from imocap_core.pipeline.runner import Job, Outcome
from imocap_core.report.action_report import finish
from imocap_core.standalone_sync.repetitions import job_in_parts
from imocap_core.workspace import Workspace

app = typer.Typer(
    name="imocap",
    help="Motion capture from several unsynchronised, uncalibrated videos.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.command("sync")(sync_command)
app.command("view")(view_command)
add_benchmarks(app)
app.command("video")(video_command)
app.command("report")(report_command)
app.command("export")(export_command)
app.command("compare")(compare_command)
app.command("people")(people_command)
app.command("detect")(detect_command)
console = speaker()

StageName = Annotated[str, typer.Argument(help="A stage of pipeline.yaml.")]
Force = Annotated[bool, typer.Option("--force", help="Run even what is cached.")]


@app.callback()
def _everywhere(
    context: typer.Context,
    root: Annotated[
        Path, typer.Option("--root", help="Folder with actions/ and artifacts/.")
    ] = Path(),
    traceback: Annotated[
        bool, typer.Option("--traceback", help="Show where an error came from.")
    ] = False,
) -> None:
    if not root.is_dir():
        raise WrongUse(f"--root {root}: there is no such folder")
    context.obj = Workspace(root)


@app.command("run")
def run_command(
    context: typer.Context,
    action: ActionName,
    force: Force = False,
    sets: Sets = [],  # noqa: B006
    until: Annotated[str | None, typer.Option(help="Stop after this stage.")] = None,
) -> None:
    """Run every stage of an action that has changed, to its report."""
    with Terminal(console) as display:
        began = time.perf_counter()
        job, cuts = job_in_parts(workspace_of(context), action, sets, display)
        stages = list(job.pipeline.stages) if until is None else _upstream(job, until)
        outcomes = runner.run(job, display, stages, frozenset(stages if force else []))
        finish(job, outcomes)
    for sentence in cuts:
        console.print(_plain(sentence))
    console.print(_summary(job, outcomes, time.perf_counter() - began))


@app.command("stage")
def stage_command(
    context: typer.Context,
    name: StageName,
    action: ActionName,
    force: Force = False,
    sets: Sets = [],  # noqa: B006
) -> None:
    """Run one stage (and what it needs, where that is not cached)."""
    with Terminal(console) as display:
        began = time.perf_counter()
        job = workspace_of(context).ready_job(action, sets, display)
        outcomes = runner.run(job, display, _upstream(job, name), frozenset([name] * force))
        finish(job, outcomes)
    console.print(_summary(job, outcomes, time.perf_counter() - began))


@app.command()
def status(context: typer.Context, action: ActionName, sets: Sets = []) -> None:  # noqa: B006
    """What is cached, what would run, and why."""
    job = workspace_of(context).job(action, sets)
    for standing in runner.standings(job):
        if standing.stored is not None:
            said = f"[dim]cached     {standing.stored.digest[:12]}[/]"
        else:
            said = f"would run  {_plain(reasons(standing.why))}"
        console.print(f"{standing.stage:<14} {said}")


@app.command()
def explain(context: typer.Context, action: ActionName, stage: StageName, sets: Sets = []) -> None:  # noqa: B006
    """Everything that a stage's result depends on, and what has changed since it was made."""
    job = workspace_of(context).job(action, sets)
    _upstream(job, stage)
    done = {}
    for standing in runner.standings(job):
        if standing.stage == stage:
            break
        if standing.stored is not None:
            done[standing.stage] = standing.stored
    console.print(f"{stage}: {standing.state}")
    missing = [name for name in job.pipeline.stages[stage].inputs if name not in done]
    if missing:
        console.print(f"  after {', '.join(missing)}")
        return
    for why in standing.why:
        console.print(f"  because {_plain(why)}")
    recipe = job.recipe(stage, done)
    console.print(f"key     {recipe.key}\nseed    {recipe.seed}")
    for title, leaves in (("input", recipe.inputs), ("read", recipe.reads), ("code", recipe.code)):
        for name, digest in leaves.items():
            console.print(f"{title:<7} {digest[:12]}  {_plain(name)}")
    for group, values in recipe.params.items():
        for name, value in values.items():
            console.print(f"param   {group}.{name} = {_plain(str(value))}")


@app.command()
def init(
    context: typer.Context,
    name: Annotated[str, typer.Argument(help="A name for the action.")],
    videos: Annotated[list[Path], typer.Argument(help="Video files of one action.")],
) -> None:
    """Make actions/NAME/action.yaml for some videos."""
    from imocap_core.cli.init import write_action

    console.print(_plain(write_action(workspace_of(context).root, name, videos)))


@app.command()
def doctor(
    context: typer.Context,
    models: Annotated[
        Path | None,
        typer.Option(
            envvar="IMOCAP_MODELS",
            exists=True,
            file_okay=False,
            help="Folder with your own SMPL, SMPL+H or SMPL-X files.",
        ),
    ] = None,
) -> None:
    """Check that everything the program needs is there and works."""
    from imocap_core.cli.doctor import examine

    faults = 0
    for finding in examine(workspace_of(context), models):
        faults += not finding.well
        console.print(
            f"{'[green]ok[/]  ' if finding.well else '[red]bad[/] '} {_plain(finding.said)}"
        )
    if faults:
        raise WorkFailed(f"{faults} of the checks above failed")


def _upstream(job: Job, stage: str) -> list[str]:
    if stage not in job.pipeline.stages:
        raise WrongUse(f"no stage {stage!r}; there are: {', '.join(job.pipeline.stages)}")
    return job.pipeline.upstream(stage)


def _summary(job: Job, outcomes: list[Outcome], seconds: float) -> str:
    made = [outcome.stage for outcome in outcomes if outcome.how == "made"]
    count = len(outcomes)
    how = f"{len(made)} made, {count - len(made)} cached" if made else "every one cached"
    where = report_page(job.store.report(job.action.name))
    end = f" Report: {where}" if where and outcomes[-1].stored.content.files else ""
    return _plain(f"{job.action.name}: {count} stages, {how}, {seconds:.1f} s.{end}")


def _plain(text: str) -> str:
    from rich.markup import escape

    return escape(text)

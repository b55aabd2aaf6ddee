"""`imocap benchmark`: its options, and which measurement each name is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.markup import escape

from imocap_core.cli.options import speaker, workspace_of
from imocap_core.cli.show import Terminal
from imocap_core.process import configure_process

Name = Literal[
    "protocol",
    "trials",
    "yoga",
    "h36m",
    "ablations",
    "solver",
    "sync",
    "trust",
    "body",
    "bones",
    "rendered",
    "lifter",
]


def benchmark_command(
    context: typer.Context,
    name: Annotated[Name, typer.Argument(help="What to measure; docs/benchmark.md says how.")],
    detector: Annotated[
        Literal["fine_tuned", "generic", "mediapipe"],
        typer.Option(help="Level of the simulated 2D detector."),
    ] = "fine_tuned",
    sampling: Annotated[
        Literal["released", "paper"], typer.Option(help="How one motion is resampled.")
    ] = "released",
    videos: Annotated[int, typer.Option(help="Videos an action, 1 to 4.")] = 4,
    only: Annotated[list[str], typer.Option(help="Run only this action (solver: part).")] = [],  # noqa: B006
    on: Annotated[
        Literal["protocol", "trials", "yoga", "h36m"], typer.Option(help="Data of the ablations.")
    ] = "trials",
    variants: Annotated[
        str, typer.Option(metavar="A,B,...", help="Run only these ablations.")
    ] = "",
    data: Annotated[
        Path | None, typer.Option(help="h36m: the folder with VideoPose3D's two files.")
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Actions at once, each with one thread.")] = 1,
    small: Annotated[
        bool, typer.Option("--small", help="rendered: pictures of 320 x 240, not 640 x 480.")
    ] = False,
    docs: Annotated[
        bool, typer.Option("--docs", help="Put the table into docs/measurements and README.md.")
    ] = False,
) -> None:
    """Measure how good the program is, what its parts are worth, or how fast the body is."""
    from benchmarks import names as benchmark

    configure_process()
    workspace = workspace_of(context)
    console = speaker()
    names = tuple(word.strip() for word in variants.split(",") if word.strip())
    wanted = benchmark.Wanted(
        name, detector, sampling, videos, tuple(only), on, names, data, jobs, docs
    )
    if name in ("body", "bones"):
        console.print(benchmark.body_table(name, workspace))
    elif name == "rendered":
        from benchmarks.rendered.command import rendered_report

        with Terminal(console) as display:
            lines = rendered_report(workspace, videos, small, tuple(only), jobs, docs, display)
        console.print(*map(escape, lines), sep="\n")
    elif name == "sync":
        said = benchmark.sync_tables(workspace, sampling, tuple(only), variants)
        console.print(escape(said))
    elif name == "lifter":
        with Terminal(console) as display:
            text, where = benchmark.lifter_table(wanted, workspace, display)
        console.print(*(escape(line) for line in (text, *where)), sep="\n")
    elif name == "trust":
        with Terminal(console) as display:
            tables = benchmark.trust_table(workspace, display)
        console.print(*tables, sep="\n")
    else:
        measure = benchmark.solver_table if name == "solver" else benchmark.motion_tables
        with Terminal(console) as display:
            text, where = measure(wanted, workspace, display)
        console.print(*(escape(line) for line in (text, *where)), sep="\n")

"""The options of `imocap benchmark`; benchmarks/names.py says which measurement each name is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from benchmarks.names import BenchmarkName, BenchmarkOptions, report_of
from imocap_core.cli.options import speaker, workspace_of


def benchmark_command(
    context: typer.Context,
    name: Annotated[
        BenchmarkName, typer.Argument(help="The measurement; benchmarks/README.md describes each.")
    ],
    detector: Annotated[
        Literal["fine_tuned", "generic", "mediapipe"],
        typer.Option(help="Noise level of the simulated 2D detector."),
    ] = "fine_tuned",
    sampling: Annotated[
        Literal["released", "paper"], typer.Option(help="How one motion is resampled.")
    ] = "released",
    videos: Annotated[
        int,
        typer.Option(
            help="Videos per action, 1 to 4 (protocol, trials: 1 to 12, as many as were captured)."
        ),
    ] = 4,
    only: Annotated[
        list[str], typer.Option(help="Run only this action (solver, speed: part; cost: size).")
    ] = [],  # noqa: B006
    on: Annotated[
        Literal["protocol", "trials", "yoga", "h36m"], typer.Option(help="Data of the ablations.")
    ] = "trials",
    variants: Annotated[
        str, typer.Option(metavar="A,B,...", help="Run only these ablations (sync: methods).")
    ] = "",
    data: Annotated[
        Path | None, typer.Option(help="h36m: the folder with VideoPose3D's two files.")
    ] = None,
    jobs: Annotated[
        int, typer.Option(min=1, help="Actions in parallel, each with one thread.")
    ] = 1,
    small: Annotated[
        bool, typer.Option("--small", help="rendered: pictures of 320 x 240, not 640 x 480.")
    ] = False,
) -> None:
    """Measure accuracy, ablations or speed."""
    from rich.markup import escape

    from imocap_core.library.terminal import Terminal
    from imocap_core.process import configure_process

    configure_process()
    workspace = workspace_of(context)
    console = speaker()
    chosen_variants = tuple(word.strip() for word in variants.split(",") if word.strip())
    options = BenchmarkOptions(
        name, detector, sampling, videos, tuple(only), on, chosen_variants, data, jobs, small
    )
    with Terminal(console) as display:
        parts = report_of(name)(options, workspace, display)
    console.print(*(escape(x) if isinstance(x, str) else x for x in parts), sep="\n")

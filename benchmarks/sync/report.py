"""`imocap benchmark sync`: accuracy by method and warp, calibration, events, slow motion, freeze
frames, speed.

`--variants slow_motion`, `freeze_frames` and `calibration` measure one of these tables alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.table import Table

from benchmarks.actions.captured import data_folder
from benchmarks.names import BenchmarkOptions
from benchmarks.sync.accuracy import METHODS, accuracy, calibrated, events
from benchmarks.sync.freeze_frames import freeze_frames
from benchmarks.sync.reliability import reliability
from benchmarks.sync.slow_motion import FACTORS, slow_motion
from benchmarks.sync.speed import speed
from benchmarks.tables import markdown_of_rows, write_rows
from imocap_core.errors import WrongUse
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace

SLOW, FREEZE, CALIBRATION = "slow_motion", "freeze_frames", "calibration"
TABLES = (SLOW, FREEZE, CALIBRATION)
SEED = 8  # of the scenes; the weights of the confidence were fitted on scenes of smaller seeds


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The tables as Markdown, and where they were written."""
    variants, only, sampling = (
        options.variants or (*METHODS, *TABLES),
        options.only,
        options.sampling,
    )
    if unknown := set(variants) - {*METHODS, *TABLES}:
        names = ", ".join((*METHODS, *TABLES))
        raise WrongUse(f"--variants: expected some of {names}, got {unknown.pop()}")
    methods = [name for name in variants if name in METHODS]
    settings = workspace.pipeline().params.sync
    protocol, trials = (data_folder(workspace.root, kind) for kind in ("protocol", "trials"))
    tables: dict[str, Sequence[Any]] = {}
    if methods:
        tables |= {
            f"accuracy-{sampling}": accuracy(protocol, sampling, settings, methods, only),
            f"calibration-{sampling}": calibrated(protocol, sampling, settings, only),
            "events": events(trials, settings, only),
            "speed": speed(settings) if not only else [],
        }
    if SLOW in variants:
        tables["slow-motion"] = slow_motion(trials, settings, FACTORS, only)
    if FREEZE in variants:
        tables["freeze-frames"] = freeze_frames(trials, settings, only)
    if CALIBRATION in variants:
        train = data_folder(workspace.root, "train") / "cmu_train.npz"
        tables["calibration-training"] = reliability(train, settings, SEED)
    folder = workspace.root / "artifacts" / "benchmark" / "sync"
    parts = []
    for name, rows in tables.items():
        if rows:
            write_rows(folder, name, rows)
            parts += [f"## {name}", markdown_of_rows(rows)]
    return ["\n\n".join([*parts, f"Written to {folder}"])]

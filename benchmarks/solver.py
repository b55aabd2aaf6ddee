"""`imocap benchmark solver`: the speed of the solver, and its rivals."""

from __future__ import annotations

import json
import multiprocessing
import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from benchmarks.names import BenchmarkOptions
from benchmarks.parallel import ForwardingDisplay
from benchmarks.scoring import peak_gb
from benchmarks.solver_race import made_scene, race
from benchmarks.tables import DETAILS, markdown_table
from imocap_core.errors import WrongUse
from imocap_core.motion.multiview.smpl_ba import solve_jointly
from imocap_core.params import FitParams, MotionParams
from imocap_core.pipeline import runner
from imocap_core.pipeline.runner import Display, Outcome
from imocap_core.workspace import Workspace

# Time and memory of SMPL-BA by number of frames, every size in its own process.

SIZES = ((4, 150), (4, 300), (8, 500), (8, 1000))


@dataclass(frozen=True)
class GrowthRow:
    """SMPL-BA on one made scene.

    seconds: on the clock; processor_s: of all cores together. growth: exponent of the processor's
    seconds by frames since the size before. load: mean number of processes ready to run in
    the minute before.
    """

    videos: int
    frames: int
    seconds: float
    processor_s: float
    processor_ms_per_frame: float
    peak_gb: float
    growth: float
    load: float


def grow(
    fit: FitParams, motion: MotionParams, seed: int, sizes: tuple[tuple[int, int], ...] = SIZES
) -> list[GrowthRow]:
    """All sizes, the smallest first."""
    rows: list[GrowthRow] = []
    spawn = multiprocessing.get_context("spawn")
    for videos, frames in sizes:
        with ProcessPoolExecutor(1, mp_context=spawn) as pool:
            row = pool.submit(measure_size, fit, motion, seed, videos, frames).result()
        rows.append(_with_growth(row, rows))
    return rows


def measure_size(
    fit: FitParams, motion: MotionParams, seed: int, videos: int, frames: int
) -> GrowthRow:
    """The row of one size, measured in this process."""
    load = os.getloadavg()[0]
    made = made_scene(videos, frames, fit, seed)
    began, began_processor = time.perf_counter(), time.process_time()
    solve_jointly(made.scene, made.start, motion)
    seconds, processor_s = time.perf_counter() - began, time.process_time() - began_processor
    per_frame = 1e3 * processor_s / (videos * frames)
    return GrowthRow(videos, frames, seconds, processor_s, per_frame, peak_gb(), float("nan"), load)


def _with_growth(row: GrowthRow, before: list[GrowthRow]) -> GrowthRow:
    if not before:
        return row
    last = before[-1]
    more = (row.videos * row.frames) / (last.videos * last.frames)
    growth = float(np.log(row.processor_s / last.processor_s) / np.log(more))
    return replace(row, growth=growth)


# The speed of the solver: by stage, against rivals, and by number of frames.
#
# All data are made by the project. Three parts (`--only`), whose rows are stored, so that the table
# always shows the last measurement of each:
#
# * stages: the demo action from its keypoints to the final motion, stage by stage;
# * race: Gauss-Newton against L-BFGS and Adam on one objective;
# * growth: SMPL-BA on 4 x 150 to 8 x 1000 frames.

STAGES = (
    *("keypoints", "camera_motion", "initial_smpl", "sync", "smpl_ba", "redetect"),
    "refine_sync",
)
FROM_KEYPOINTS = tuple(stage for stage in STAGES if stage != "camera_motion")  # reads the videos
RACE_SIZE = (4, 40)  # videos, frames
MOST_TIMES = 25.0  # a rival may take this many times Gauss-Newton's time
HEADS = {
    "growth": "SMPL-BA by number of frames: synthetic scenes, two cores",
    "race": f"To the same objective: the common motion of {RACE_SIZE[0]} x {RACE_SIZE[1]} frames "
    "and its cameras, one core",
    "stages": "From keypoints to the final motion: yoga, four videos of 146 to 186 frames",
}
NOTES = {
    "stages": "Seconds on the clock and of the processor. camera_motion reads the videos and is "
    "not in the sum. load: mean number of processes ready to run in the minute before.",
    "race": "Processor seconds to an objective within 0.1 % of the lowest that Gauss-Newton "
    f"reaches; a rival is stopped after {MOST_TIMES:g} times its time. above_pct: lowest objective "
    "above Gauss-Newton's. times: multiple of Gauss-Newton's time (median of three runs, between "
    "the rivals).",
    "growth": "Every size in its own process; peak_gb: its peak memory. growth: "
    "exponent of the processor's seconds by frames, 1 is linear.",
}


@dataclass(frozen=True)
class StageTimeRow:
    """The time of one stage."""

    stage: str
    seconds: float
    processor_s: float
    load: float


@dataclass
class StageTimer(ForwardingDisplay):
    """A display that also records the time of every stage, of all its threads."""

    rows: list[StageTimeRow] = field(default_factory=list)
    _began: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def started(self, stage: str, why: list[str]) -> None:
        """Start the clocks."""
        self.display.started(stage, why)
        self._began = time.perf_counter(), time.process_time(), os.getloadavg()[0]

    def finished(self, outcome: Outcome) -> None:
        """Record the time."""
        began, processor, load = self._began
        seconds, processor_s = time.perf_counter() - began, time.process_time() - processor
        self.rows.append(StageTimeRow(outcome.stage, seconds, processor_s, load))
        self.display.finished(outcome)


def measure(workspace: Workspace, only: Sequence[str], display: Display, folder: Path) -> str:
    """Measure the chosen parts (all when none is named) and store their rows; the table of all
    stored rows."""
    if unknown := sorted(set(only) - set(HEADS)):
        raise WrongUse(f"--only {unknown[0]}: expected some of {', '.join(HEADS)}")
    folder.mkdir(parents=True, exist_ok=True)
    work: dict[str, Callable[[], Sequence[Any]]] = {
        "stages": lambda: stage_rows(workspace, display),
        "race": lambda: _race(workspace),
        "growth": lambda: _growth(workspace),
    }
    for part in HEADS:
        if not only or part in only:
            rows = [asdict(row) for row in work[part]()]
            (folder / f"{part}.json").write_text(json.dumps(rows, indent=1) + "\n")
    text = markdown(folder)
    (folder / "table.md").write_text(text + "\n", encoding="utf-8")
    return text


def stage_rows(workspace: Workspace, display: Display) -> list[StageTimeRow]:
    """Every stage, run again; and the sum from keypoints to the final motion."""
    job = workspace.ready_job("yoga", [], display)
    timer = StageTimer(display)
    runner.run(job, timer, list(STAGES), frozenset(STAGES))
    counted = [row for row in timer.rows if row.stage in FROM_KEYPOINTS]
    seconds, processor_s = (sum(getattr(r, f) for r in counted) for f in ("seconds", "processor_s"))
    return [*timer.rows, StageTimeRow("**sum**", seconds, processor_s, counted[0].load)]


def markdown(folder: Path) -> str:
    """The stored rows of every part that was measured."""
    parts = [
        "# Speed of the solver",
        "Made by `imocap benchmark solver`. Data: made by the project.",
    ]
    for part, head in HEADS.items():
        if part == "race":
            parts.append(DETAILS)
        file = folder / f"{part}.json"
        if file.is_file():
            parts += [f"## {head}", NOTES[part], _table(json.loads(file.read_text()))]
        else:
            parts.append(f"**Not measured: {part}.**")
    return "\n\n".join(parts)


def _race(workspace: Workspace) -> Sequence[Any]:
    pipeline = workspace.pipeline()
    scene = made_scene(*RACE_SIZE, pipeline.params.fit, pipeline.seed)
    return race(scene, pipeline.params.motion, MOST_TIMES)


def _growth(workspace: Workspace) -> Sequence[Any]:
    pipeline = workspace.pipeline()
    return grow(pipeline.params.fit, pipeline.params.motion, pipeline.seed)


def _table(rows: list[dict[str, Any]]) -> str:
    return markdown_table(list(rows[0]), [[_cell(value) for value in row.values()] for row in rows])


def _cell(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "did not reach it"
    if isinstance(value, float):
        return "–" if value != value else f"{value:.2f}"
    return str(value)


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The table as Markdown, and what was written."""
    folder = workspace.root / "artifacts" / "benchmark" / "solver"
    text = measure(workspace, options.only, display, folder)
    return [text, f"Written to {folder}"]

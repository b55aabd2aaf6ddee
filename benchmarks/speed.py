"""`imocap benchmark speed` (`make bench`): each fast part beside a named alternative."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from rich.table import Table
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from benchmarks import speed_rivals
from benchmarks.cost_action import ActionSize, make_sized_action
from benchmarks.names import BenchmarkOptions
from benchmarks.solver_race import NEWTON, RaceRow, made_scene, one_core, race
from benchmarks.sync import VIDEOS, made_poses
from benchmarks.tables import ABSENT, DETAILS, cell, markdown_table, write_rows, write_texts
from imocap_core.body import keypoints_with_jacobian, load_free_body
from imocap_core.errors import WrongUse
from imocap_core.library.running import run_action
from imocap_core.params import FitParams, MotionParams, SyncParams
from imocap_core.params.sync_params import CycleMethod
from imocap_core.pipeline.runner import Display
from imocap_core.rotations import exp
from imocap_core.sync.affinity import distance_matrix
from imocap_core.sync.cycle import relax
from imocap_core.sync.maps import BlockMaps
from imocap_core.sync.procrustes import procrustes_distances
from imocap_core.sync.reference import compared_pairs
from imocap_core.sync.warp.dtw import dtw
from imocap_core.sync.warp.soft_maps import Clocks
from imocap_core.workspace import Workspace

# Processor time of two ways to do the same work, measured in turn, at two sizes.

REPETITIONS = 5  # repetitions of each; the shortest counts


@dataclass(frozen=True)
class Entrants:
    """One size of a contest: the amount of work that the growth is by, and both ways to do it."""

    amount: int
    ours: Callable[[], object]
    rival: Callable[[], object]


@dataclass(frozen=True)
class RatioRow:
    """A part of the program and its rival at one size.

    ours_ms, rival_ms: processor time. ratio: rival's over ours; at_least: the rival was stopped at
    this multiple. growth: exponents of both times by the amount since the size before, NaN for
    the first.
    """

    part: str
    rival: str
    size: str
    ours_ms: float
    rival_ms: float
    ratio: float
    at_least: bool = False
    growth: float = math.nan
    rival_growth: float = math.nan


def contest(
    part: str, rival: str, unit: str, sizes: Sequence[Entrants], seconds: float
) -> list[RatioRow]:
    """A row a size, the smaller first; up to `seconds` for each, at least one call of both."""
    rows = []
    for entrants in sizes:
        ours, theirs = _in_turn(entrants, seconds)
        rows.append(
            RatioRow(part, rival, f"{entrants.amount:,} {unit}", ours, theirs, theirs / ours)
        )
    return with_growth(rows, [entrants.amount for entrants in sizes])


def with_growth(rows: Sequence[RatioRow], amounts: Sequence[int]) -> list[RatioRow]:
    """The rows of one contest with their exponents. amounts: of work, ascending."""
    out = list(rows[:1])
    for k in range(1, len(rows)):
        before, row, more = rows[k - 1], rows[k], math.log(amounts[k] / amounts[k - 1])
        growth = math.log(row.ours_ms / before.ours_ms) / more
        rival_growth = math.log(row.rival_ms / before.rival_ms) / more
        out.append(replace(row, growth=growth, rival_growth=rival_growth))
    return out


def _in_turn(entrants: Entrants, seconds: float) -> tuple[float, float]:
    """Shortest processor times of both, ms; ours is called once before, to load what it needs."""
    entrants.ours()
    best = [math.inf, math.inf]
    began = time.perf_counter()
    for repeat in range(REPETITIONS):
        if repeat and time.perf_counter() - began > seconds:
            break
        for k, work in enumerate((entrants.ours, entrants.rival)):
            start = time.process_time()
            work()
            best[k] = min(best[k], max(time.process_time() - start, 1e-6))
    return 1e3 * best[0], 1e3 * best[1]


# What is measured beside what.

SECONDS = 8.0  # for each size
MOST_TIMES = 10.0  # of Gauss-Newton's time, after which a rival of it is stopped
AFFINITY_FRAMES, CYCLE_FRAMES, DTW_FRAMES = (75, 150), (300, 600), (150, 450)
BODIES = (100, 400)
VIEWS, SOLVED_FRAMES, PROBLEM = 4, (20, 40), "rigid copies"
SOLVERS = {"lbfgs": "L-BFGS (SciPy)", "adam": "Adam"}
PIPELINE_VIDEOS, PIPELINE_FRAMES = 3, (60, 120)
FPS = 30.0


def affinity() -> list[RatioRow]:
    """Distances of all pairs of frames of two videos."""
    entrants = []
    for frames in AFFINITY_FRAMES:
        first, second = made_poses(VIDEOS * frames, np.random.default_rng(frames))[:2]
        ones = np.ones(first.shape[:2])
        ours = partial(procrustes_distances, first, second, ones, ones)
        entrants.append(
            Entrants(frames, ours, partial(speed_rivals.procrustes_by_svd, first, second))
        )
    return contest("affinity", "NumPy's SVD, pair by pair", "frames each", entrants, SECONDS)


def cycle_consistency(params: SyncParams) -> list[RatioRow]:
    """Soft maps of four videos made consistent, by the default and by the dense solver."""
    entrants = []
    for frames in CYCLE_FRAMES:
        maps = _soft_maps(frames, params)
        ours, rival = (partial(_relaxed, method, maps, params) for method in (params.method, "svt"))
        entrants.append(Entrants(frames, ours, rival))
    name = f"cycle consistency ({params.method})"
    return contest(name, "ADMM with dense SVDs", "frames in 4 videos", entrants, SECONDS)


def time_warping() -> list[RatioRow]:
    """The cheapest path: by loops in Python, and by dtaidistance's C where that is installed."""
    series = {n: np.random.default_rng(n).normal(size=(2, n)).cumsum(axis=1) for n in DTW_FRAMES}
    rivals: dict[str, Callable[[Any, Any], object]] = {"loops in Python": speed_rivals.dtw_by_loops}
    if find_spec("dtaidistance") is not None:
        rivals["dtaidistance (C)"] = import_module("dtaidistance.dtw").warping_path_fast
    return [
        row
        for name, rival in rivals.items()
        for row in contest(
            "time warping",
            name,
            "frames each",
            [Entrants(n, partial(_warped, *x), partial(rival, *x)) for n, x in series.items()],
            SECONDS,
        )
    ]


def body_jacobian() -> list[RatioRow]:
    """Keypoints and their derivatives by pose and shape, float64, one thread."""
    model = load_free_body(dtype=torch.float64)
    points = model.points(speed_rivals.LAYOUT)
    automatic = speed_rivals.automatic_jacobian(model, points)
    entrants = []
    for bodies in BODIES:
        rng = np.random.default_rng(bodies)
        theta, transl, betas = (
            torch.as_tensor(rng.normal(size=shape)) for shape in ((bodies, 24, 3), (bodies, 3), 10)
        )
        theta = 0.4 * theta
        ours = partial(_jacobian, model, points, exp(theta), transl, betas)
        entrants.append(Entrants(bodies, ours, partial(automatic, theta, betas, transl)))
    return contest("body's Jacobian", "torch.func.jacfwd", "bodies", entrants, SECONDS)


def solver(fit: FitParams, motion: MotionParams, seed: int) -> list[RatioRow]:
    """Gauss-Newton to an objective, and general solvers to the same one (rigid copies)."""
    raced = [
        (frames, race(made_scene(VIEWS, frames, fit, seed), motion, MOST_TIMES, [PROBLEM]))
        for frames in SOLVED_FRAMES
    ]
    return [
        row
        for solver, name in SOLVERS.items()
        for row in with_growth(
            [_solver_row(name, solver, frames, rows) for frames, rows in raced], SOLVED_FRAMES
        )
    ]


def motion_alone_solvers(fit: FitParams, motion: MotionParams, seed: int) -> list[RatioRow]:
    """One motion with known cameras and shape: Gauss-Newton and general least-squares solvers."""
    rivals: dict[str, speed_rivals.Race] = {"SciPy's least_squares": speed_rivals.scipy_solve}
    if find_spec("pyceres") is not None:
        rivals["Ceres, without its residuals' time"] = speed_rivals.ceres_solve
    problems = {
        n: speed_rivals.motion_alone(made_scene(VIEWS, n, fit, seed), motion) for n in SOLVED_FRAMES
    }
    rows = []
    for name, rival in rivals.items():
        raced = []
        for frames, problem in problems.items():
            seconds, watch = speed_rivals.motion_race(problem, rival, MOST_TIMES)
            ours, theirs = 1e3 * seconds, 1e3 * watch.ended_s
            size, stopped = f"{VIEWS} x {frames} frames", not watch.reached
            raced.append(
                RatioRow("motion alone", name, size, ours, theirs, theirs / ours, at_least=stopped)
            )
        rows += with_growth(raced, SOLVED_FRAMES)
    return rows


def whole_pipeline() -> list[RatioRow]:
    """From keypoints and cameras to the final motion, nothing beside it."""
    rows = []
    for frames in PIPELINE_FRAMES:
        with TemporaryDirectory() as folder:
            size, root = ActionSize(PIPELINE_VIDEOS, frames), Path(folder)
            make_sized_action(root / size.name, size)
            run_action(root / size.name, root=root, until="camera_motion")
            began = time.process_time()
            run_action(root / size.name, root=root, until="refine_sync")
            ours = 1e3 * (time.process_time() - began)
        shown = f"{PIPELINE_VIDEOS} x {frames} frames"
        rows.append(RatioRow("keypoints to motion", ABSENT, shown, ours, math.nan, math.nan))
    return with_growth(rows, PIPELINE_FRAMES)


def _solver_row(name: str, solver: str, frames: int, raced: Sequence[RaceRow]) -> RatioRow:
    by_solver = {row.solver: row for row in raced}
    newton, rival = by_solver[NEWTON], by_solver[solver]
    ours_ms, rival_ms = 1e3 * newton.seconds, 1e3 * rival.seconds
    return RatioRow(
        "motion solver",
        name,
        f"{VIEWS} x {frames} frames",
        ours_ms,
        rival_ms,
        rival_ms / ours_ms,
        at_least=not rival.reached,
    )


def _soft_maps(frames: int, params: SyncParams) -> BlockMaps:
    poses, fps = made_poses(frames, np.random.default_rng(frames)), [FPS] * VIDEOS
    distances = distance_matrix(poses, None, fps, params)
    return compared_pairs(distances, Clocks(fps, np.ones(VIDEOS)), params, range(VIDEOS)).soft_maps


def _relaxed(method: CycleMethod, maps: BlockMaps, params: SyncParams) -> object:
    return relax(method, maps, rounds=params.rounds, rng=np.random.default_rng(0))


def _warped(a: Float[np.ndarray, " N"], b: Float[np.ndarray, " S"]) -> object:
    return dtw((a[:, None] - b) ** 2)


def _jacobian(model: Any, points: Any, R_local: Any, transl: Any, betas: Any) -> object:
    return keypoints_with_jacobian(model.shape(betas), points, R_local, transl)


NAME = "speed"
HEAD = (
    *("part", "beside", "size", "ours (ms)", "it (ms)", "times as long"),
    *("growth, ours", "growth, it"),
)


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """All contests (`--only affinity` for some), one core, processor time."""
    pipeline = workspace.pipeline()
    params = pipeline.params
    parts: dict[str, Callable[[], list[RatioRow]]] = {
        "affinity": affinity,
        "cycle": lambda: cycle_consistency(params.sync),
        "dtw": time_warping,
        "body": body_jacobian,
        "solver": lambda: solver(params.fit, params.motion, pipeline.seed),
        "motion": lambda: motion_alone_solvers(params.fit, params.motion, pipeline.seed),
        "pipeline": whole_pipeline,
    }
    if unknown := sorted(set(options.only) - set(parts)):
        raise WrongUse(f"--only {unknown[0]}: expected some of {', '.join(parts)}")
    rows = []
    with one_core(), threadpool_limits(1):
        for name in options.only or parts:
            rows += parts[name]()
    folder = workspace.root / "artifacts" / "benchmark" / NAME
    text = f"{summary(rows)}\n{DETAILS}\n\n{markdown(rows)}"
    write_rows(folder, "results", rows)
    write_texts(folder, {"table.md": text})
    return [text, f"Written to {folder}"]


def markdown(rows: Sequence[RatioRow]) -> str:
    """The table; a rival that was stopped took more than the multiple that it has."""
    cells = [
        [
            row.part,
            row.rival,
            row.size,
            _thousands(row.ours_ms),
            f"{'> ' if row.at_least else ''}{_thousands(row.rival_ms)}",
            f"{'> ' if row.at_least else ''}{_ratio(row.ratio)}",
            cell(row.growth, 1),
            cell(math.nan if row.at_least else row.rival_growth, 1),
        ]
        for row in rows
    ]
    return markdown_table(HEAD, cells) + "\n"


def summary(rows: Sequence[RatioRow]) -> str:
    """The ratio at the larger size of every contest."""
    largest = {(row.part, row.rival): row for row in rows if not math.isnan(row.ratio)}
    cells = [
        [row.part, row.rival, row.size, f"{'> ' if row.at_least else ''}{_ratio(row.ratio)}"]
        for row in largest.values()
    ]
    return markdown_table(HEAD[:3] + HEAD[5:6], cells) + "\n"


def _ratio(value: float) -> str:
    if math.isnan(value):
        return ABSENT
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def _thousands(value: float) -> str:
    return ABSENT if math.isnan(value) else f"{value:,.1f}"

"""What is measured beside what."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from benchmarks.body.speed import LAYOUT, automatic_jacobian
from benchmarks.cost.action import ActionSize, make_sized_action
from benchmarks.solver.race import NEWTON, RaceRow, race
from benchmarks.solver.scene import made_scene
from benchmarks.speed.contest import Entrants, RatioRow, contest, with_growth
from benchmarks.speed.least_squares import Race, ceres_solve, motion_race, scipy_solve
from benchmarks.speed.motion_alone import motion_alone
from benchmarks.speed.rivals import dtw_by_loops, procrustes_by_svd
from benchmarks.sync.speed import VIDEOS, made_poses
from benchmarks.tables import ABSENT
from imocap_core.body import keypoints_with_jacobian, load_free_body
from imocap_core.library.running import run_action
from imocap_core.params import FitParams, MotionParams, SyncParams
from imocap_core.params.sync_params import CycleMethod
from imocap_core.rotations import exp
from imocap_core.sync.affinity import distance_matrix
from imocap_core.sync.cycle import relax
from imocap_core.sync.maps import BlockMaps
from imocap_core.sync.procrustes import procrustes_distances
from imocap_core.sync.reference import compared_pairs
from imocap_core.sync.warp.dtw import dtw
from imocap_core.sync.warp.soft_maps import Clocks

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
        entrants.append(Entrants(frames, ours, partial(procrustes_by_svd, first, second)))
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
    rivals: dict[str, Callable[[Any, Any], object]] = {"loops in Python": dtw_by_loops}
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
    points = model.points(LAYOUT)
    automatic = automatic_jacobian(model, points)
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
    rivals: dict[str, Race] = {"SciPy's least_squares": scipy_solve}
    if find_spec("pyceres") is not None:
        rivals["Ceres, without its residuals' time"] = ceres_solve
    problems = {n: motion_alone(made_scene(VIEWS, n, fit, seed), motion) for n in SOLVED_FRAMES}
    rows = []
    for name, rival in rivals.items():
        raced = []
        for frames, problem in problems.items():
            seconds, watch = motion_race(problem, rival, MOST_TIMES)
            ours, theirs = 1e3 * seconds, 1e3 * watch.ended_s
            size, stopped = f"{VIEWS} x {frames} frames", not watch.reached
            raced.append(
                RatioRow("motion alone", name, size, ours, theirs, theirs / ours, at_least=stopped)
            )
        rows += with_growth(raced, SOLVED_FRAMES)
    return rows


def pipeline() -> list[RatioRow]:
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

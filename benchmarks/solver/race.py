"""Gauss-Newton against its rivals on one objective, from one start, on one core.

The objective is that of the motion common to all videos, with its cameras, at its first and widest
robust scale: once for performances that are rigid copies, once with a rigid offset per frame. Every
solver gets it as a single term that watches the clock, so all are timed in the same way: by the
processor time of this process until a point no higher than the target has been evaluated.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from torch import Tensor

from benchmarks.solver.adam import adam
from benchmarks.solver.lbfgs import lbfgs
from benchmarks.solver.scene import MadeScene
from imocap_core.motion.gauss_newton import Solution, gauss_newton, objective
from imocap_core.motion.monocular.fit import regularisers
from imocap_core.motion.multiview.common_motion import (
    ROBUST_STAGES,
    CommonViews,
    Unknowns,
    common_problem,
    with_initial_offsets,
)
from imocap_core.motion.multiview.low_rank import consensus_motion
from imocap_core.motion.multiview.scene import cameras_from_motion
from imocap_core.motion.multiview.smpl_ba import shared_shapes
from imocap_core.motion.normal import NormalEquations
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms import Term
from imocap_core.params import MotionParams

Solver = Callable[[Sequence[Term], MotionState], Solution]

TARGET = 1.001  # times the lowest objective that Gauss-Newton reaches
NEWTON = "gauss_newton"
NEWTON_STEPS, NEWTON_TOLERANCE = 40, 1e-4
MANY_STEPS = 1_000_000  # a rival is stopped by the clock
PROBLEMS = {"rigid copies": False, "rigid offsets": True}  # whether the views have offsets
RIVALS: dict[str, Solver] = {
    "lbfgs": lambda terms, start: lbfgs(
        terms, start, max_steps=MANY_STEPS, relative_tolerance=1e-12
    ),
    "adam": lambda terms, start: adam(terms, start, max_steps=MANY_STEPS),
}


@dataclass(frozen=True)
class RaceRow:
    """One solver: seconds of processor time until it reached the target or was stopped, its lowest
    objective by then in % above Gauss-Newton's, and its time as a multiple of Gauss-Newton's."""

    problem: str
    solver: str
    reached: bool
    seconds: float
    evaluations: int
    above_pct: float
    times: float


class RaceOver(Exception):
    """The target is reached, or the time is up."""


@dataclass
class TimedTerm:
    """All terms as one that raises `RaceOver` when the target is reached or the time is up."""

    terms: Sequence[Term]
    target: float
    limit_s: float
    began: float = field(default_factory=time.process_time)
    lowest: float = float("inf")
    evaluations: int = 0

    @property
    def spent(self) -> float:
        """Seconds of processor time since the start."""
        return time.process_time() - self.began

    def cost(self, state: MotionState) -> Tensor:
        """Their sum; `RaceOver` when there is no need to go on."""
        cost = objective(self.terms, state)
        value = float(cost.detach().sum())
        self.evaluations += 1
        self.lowest = min(self.lowest, value)
        if value <= self.target or self.spent > self.limit_s:
            raise RaceOver
        return cost

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """Add every term's normal equations."""
        for term in self.terms:
            term.add_to(normal, state)

    def of(self, v: int, frames: int) -> TimedTerm:
        """The terms of motion v: there is only one motion."""
        assert v == 0
        return self


def race(
    made: MadeScene,
    options: MotionParams,
    most_times: float,
    problems: Sequence[str] = tuple(PROBLEMS),
) -> list[RaceRow]:
    """Every problem: Gauss-Newton, then each rival with Gauss-Newton again after it; a rival may
    take `most_times` the time of the slowest Gauss-Newton so far."""
    with one_core():
        return [
            row
            for name in problems
            for row in _race(
                name, *first_common_problem(made, options, rigid_offsets=PROBLEMS[name]), most_times
            )
        ]


def _race(
    problem: str, terms: Sequence[Term], start: MotionState, most_times: float
) -> list[RaceRow]:
    target = TARGET * newton(terms, start).costs[-1]
    never = float("inf")
    ours, rivals = [timed(problem, NEWTON, newton, terms, start, target, never)], []
    for name, solver in RIVALS.items():
        limit = most_times * max(row.seconds for row in ours)
        rivals.append(timed(problem, name, solver, terms, start, target, limit))
        ours.append(timed(problem, NEWTON, newton, terms, start, target, never))
    seconds = float(np.median([row.seconds for row in ours]))
    rows = [replace(ours[0], seconds=seconds), *rivals]
    return [replace(row, times=row.seconds / seconds) for row in rows]


def newton(terms: Sequence[Term], start: MotionState) -> Solution:
    """Gauss-Newton until it has converged."""
    return gauss_newton(terms, start, max_steps=NEWTON_STEPS, relative_tolerance=NEWTON_TOLERANCE)


def timed(
    problem: str,
    name: str,
    solver: Solver,
    terms: Sequence[Term],
    start: MotionState,
    target: float,
    limit_s: float,
) -> RaceRow:
    """The row of one solver, without its multiple of Gauss-Newton's time."""
    term = TimedTerm(terms, target, limit_s)
    with suppress(RaceOver):
        solver([term], start)
    seconds, above_pct = term.spent, 100.0 * (TARGET * term.lowest / target - 1.0)
    reached = term.lowest <= target
    return RaceRow(problem, name, reached, seconds, term.evaluations, above_pct, 0.0)


def first_common_problem(
    made: MadeScene, options: MotionParams, *, rigid_offsets: bool
) -> tuple[list[Term], MotionState]:
    """The terms and the start of the first fit of one motion to all views."""
    scene, state = made.scene, shared_shapes(made.start, made.scene.performers)
    K = scene.K.to(state.trans)
    cameras = cameras_from_motion(scene.aligned(state), K, scene.reference)
    keypoints = with_initial_offsets(scene, options) if rigid_offsets else scene.keypoints
    motion = consensus_motion(scene, state, cameras, options.agreement_rad)
    free = [v for v in range(len(scene.observations)) if v != scene.reference]
    scale = scene.fit.robust_scale_sigma * ROBUST_STAGES[0]
    views = CommonViews(scene.body, keypoints, cameras, scale)
    image, start = common_problem(views, motion, Unknowns(free))
    return [*image, *regularisers(scene.body, scene.prior, scene.fit, scene.fps)], start


@contextmanager
def one_core() -> Iterator[None]:
    """This process on one core, where the system supports it, and torch on one thread."""
    threads = torch.get_num_threads()
    able = hasattr(os, "sched_setaffinity")
    cores = os.sched_getaffinity(0) if able else set()
    torch.set_num_threads(1)
    if able:
        os.sched_setaffinity(0, {max(cores)})
    try:
        yield
    finally:
        torch.set_num_threads(threads)
        if able:
            os.sched_setaffinity(0, cores)

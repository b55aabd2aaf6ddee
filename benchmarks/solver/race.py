"""Gauss-Newton against its rivals on one objective, from one start, on one core.

The objective is that of the motion common to all videos, with its cameras, at its first and widest
robust scale: of performances that are rigid copies, and of ones that stray from each other as
wholes. Every solver sees it as a single term that looks at the clock, so all are timed alike: by
the processor time of this process until a point no higher than the mark has been evaluated.
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
from imocap_core.motion.monocular.fit import regularisers
from imocap_core.motion.multiview.common import ROBUST_STAGES
from imocap_core.motion.multiview.consensus import align, cameras_from_motion
from imocap_core.motion.multiview.coupled import consensus_motion
from imocap_core.motion.multiview.joint import one_body
from imocap_core.motion.multiview.rigid_offsets import first_strays
from imocap_core.motion.multiview.shared import gather, shared_problem
from imocap_core.motion.solver.gauss_newton import Solution, gauss_newton
from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.solver.objective import objective
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms import Term
from imocap_core.params import MotionParams

Run = Callable[[Sequence[Term], MotionState], Solution]

MARK = 1.001  # times the lowest objective that Gauss-Newton reaches
NEWTON = "gauss_newton"
NEWTON_STEPS, NEWTON_TOLERANCE = 40, 1e-4
MANY_STEPS = 1_000_000  # the clock ends a rival
RIVALS: dict[str, Run] = {
    "lbfgs": lambda terms, start: lbfgs(
        terms, start, max_steps=MANY_STEPS, relative_tolerance=1e-12
    ),
    "adam": lambda terms, start: adam(terms, start, max_steps=MANY_STEPS),
}


@dataclass(frozen=True)
class RaceRow:
    """A solver's way to the mark: seconds of processor time until it was there or was stopped, the
    lowest objective by then in % above Gauss-Newton's, and how many times Gauss-Newton's time."""

    problem: str
    solver: str
    reached: bool
    seconds: float
    evaluations: int
    above_pct: float
    times: float


class Over(Exception):
    """The mark is reached, or the time is up."""


@dataclass
class Watched:
    """All terms as one that notes when the mark is reached, and stops there."""

    terms: Sequence[Term]
    mark: float
    limit_s: float
    began: float = field(default_factory=time.process_time)
    lowest: float = float("inf")
    evaluations: int = 0

    @property
    def spent(self) -> float:
        """Seconds of processor time since the start."""
        return time.process_time() - self.began

    def cost(self, state: MotionState) -> Tensor:
        """Their sum; `Over` when there is no need to go on."""
        cost = objective(self.terms, state)
        value = float(cost.detach().sum())
        self.evaluations += 1
        self.lowest = min(self.lowest, value)
        if value <= self.mark or self.spent > self.limit_s:
            raise Over
        return cost

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """Theirs."""
        for term in self.terms:
            term.add_to(normal, state)

    def of(self, v: int, frames: int) -> Watched:
        """There is one motion only."""
        assert v == 0
        return self


def race(made: MadeScene, options: MotionParams, most_times: float) -> list[RaceRow]:
    """Both problems: Gauss-Newton, then each rival with Gauss-Newton again after it; a rival is
    given `most_times` the time of the slowest Gauss-Newton so far."""
    with one_core():
        return [
            row
            for name, strays in (("rigid copies", False), ("strays", True))
            for row in _race(name, *common_problem(made, options, strays=strays), most_times)
        ]


def _race(
    problem: str, terms: Sequence[Term], start: MotionState, most_times: float
) -> list[RaceRow]:
    mark = MARK * newton(terms, start).costs[-1]
    never = float("inf")
    ours, rivals = [watched(problem, NEWTON, newton, terms, start, mark, never)], []
    for name, run in RIVALS.items():
        limit = most_times * max(row.seconds for row in ours)
        rivals.append(watched(problem, name, run, terms, start, mark, limit))
        ours.append(watched(problem, NEWTON, newton, terms, start, mark, never))
    seconds = float(np.median([row.seconds for row in ours]))
    rows = [replace(ours[0], seconds=seconds), *rivals]
    return [replace(row, times=row.seconds / seconds) for row in rows]


def newton(terms: Sequence[Term], start: MotionState) -> Solution:
    """Gauss-Newton to where it settles."""
    return gauss_newton(terms, start, max_steps=NEWTON_STEPS, relative_tolerance=NEWTON_TOLERANCE)


def watched(
    problem: str,
    solver: str,
    run: Run,
    terms: Sequence[Term],
    start: MotionState,
    mark: float,
    limit_s: float,
) -> RaceRow:
    """One solver's way to the mark."""
    watch = Watched(terms, mark, limit_s)
    with suppress(Over):
        run([watch], start)
    seconds, above_pct = watch.spent, 100.0 * (MARK * watch.lowest / mark - 1.0)
    reached = watch.lowest <= mark
    return RaceRow(problem, solver, reached, seconds, watch.evaluations, above_pct, 0.0)


def common_problem(
    made: MadeScene, options: MotionParams, *, strays: bool
) -> tuple[list[Term], MotionState]:
    """The first fit of one motion to all views."""
    scene, weights = made.scene, made.scene.weights
    state = one_body(made.start)
    aligned = align(scene.body, state, scene.timeline)
    cameras = cameras_from_motion(aligned, scene.K.to(state.trans), scene.reference)
    evidence = gather(scene.observations, scene.timeline)
    if strays:
        evidence = replace(evidence, stray=first_strays(len(scene.observations), options))
    shared = consensus_motion(scene, state, cameras, options)
    free = [v for v in range(len(scene.observations)) if v != scene.reference]
    scale = weights.robust_scale_sigma * ROBUST_STAGES[0]
    seen, start = shared_problem(scene.body, shared, evidence, cameras, free, robust_scale=scale)
    return [*seen, *regularisers(scene.body, scene.prior, weights, scene.fps)], start


@contextmanager
def one_core() -> Iterator[None]:
    """This process on one core, where the system can, and torch on one thread."""
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

"""A synthetic action of any length, as the solver takes it, for measuring the solver's speed.

Poses are drawn from the pose prior and joined smoothly; every video shows another performance that
deviates from them, before another camera on a circle, with a detector's noise. Correspondences are
the true ones, frame to frame, and every start has a smooth error.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import OptimizeResult, minimize
from torch import Tensor

from imocap_core.body import load_free_body
from imocap_core.motion.gauss_newton import Solution, gauss_newton, objective
from imocap_core.motion.multiview import common_motion
from imocap_core.motion.multiview.scene import (
    Scene,
    cameras_from_motion,
    consensus_motion,
    shared_shapes,
)
from imocap_core.motion.multiview.timeline import make_timeline
from imocap_core.motion.normal import NormalEquations
from imocap_core.motion.observations import Observation
from imocap_core.motion.prior import load_pose_prior
from imocap_core.motion.state import FRAME_UNKNOWNS, Body, MotionState
from imocap_core.motion.terms.base import Term
from imocap_core.params import FitParams, MotionParams
from imocap_core.rotations import exp

FPS = 30.0
LAYOUT = "body25"
K = np.array([[1000.0, 0, 500], [0, 1000.0, 500], [0, 0, 1]])
DISTANCE_M = 4.5
KEY_FRAMES = 20  # between two poses
NOISE_PX, NOISE_SHARE = 3.0, 0.01
DEVIATION_RAD, DEVIATION_M = 0.05, 0.05
ERROR_RAD, ERROR_M = 0.1, 0.1  # of the start
SMOOTH_FRAMES = 10.0


@dataclass(frozen=True)
class MadeScene:
    """The input of `solve_jointly`."""

    scene: Scene
    start: MotionState


def made_scene(videos: int, frames: int, weights: FitParams, seed: int) -> MadeScene:
    """`videos` performances of one synthetic motion, `frames` frames each."""
    rng = np.random.default_rng([seed, videos, frames])
    body = Body.of(load_free_body(), LAYOUT)
    theta, path = _motion(frames, rng)
    observations, starts = [], []
    for turn_rad in 2 * np.pi * np.arange(videos) / videos:
        state = _performance(body, theta, path, float(turn_rad), rng)
        observations.append(_observed(body, state, rng))
        error = _smooth((frames, 75), rng) * np.array([ERROR_RAD] * 72 + [ERROR_M] * 3)
        starts.append(state.retract(torch.as_tensor(error)[None], torch.zeros_like(state.betas)))
    maps = [np.arange(frames, dtype=np.float64) for _ in range(videos)]
    confidence = [np.ones(frames) for _ in range(videos)]
    scene = Scene(
        body,
        load_pose_prior(),
        observations,
        make_timeline(maps, confidence, frames),
        confidence,
        0,
        weights,
    )
    parts = (torch.cat([getattr(s, name) for s in starts]) for name in ("R_local", "trans"))
    R_local, trans = parts
    valid = torch.ones(videos, frames, dtype=torch.bool)
    return MadeScene(scene, MotionState.of(R_local, trans, trans.new_zeros(videos, 10), valid))


def _motion(
    frames: int, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "T 24 3"], Float[np.ndarray, "T 3"]]:
    """Axis angles, upright and slowly turning in y-up axes, and the path of the root about the
    origin, metres."""
    keys = -(-frames // KEY_FRAMES) + 1
    poses = load_pose_prior().sample(keys, rng, spread=0.5)
    times = np.arange(frames) / KEY_FRAMES
    articulation = CubicSpline(np.arange(keys), poses)(times).reshape(frames, 23, 3)
    turn = np.zeros((frames, 1, 3))
    turn[:, 0, 1] = 0.5 * _smooth((frames, 1), rng)[:, 0]
    return np.concatenate([turn, articulation], axis=1), 0.2 * _smooth((frames, 3), rng)


def _performance(
    body: Body,
    theta: Float[np.ndarray, "T 24 3"],
    path: Float[np.ndarray, "T 3"],
    turn_rad: float,
    rng: np.random.Generator,
) -> MotionState:
    """One performance (batch of 1) in the axes of a camera at `turn_rad` on the circle."""
    frames = len(theta)
    R_local = exp(torch.as_tensor(theta + DEVIATION_RAD * _smooth((frames, 24, 3), rng)))
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    R_cam_from_world = np.diag([1.0, -1.0, -1.0]) @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    R_local[:, 0] = torch.as_tensor(R_cam_from_world) @ R_local[:, 0]
    root = (path + DEVIATION_M * _smooth((frames, 3), rng)) @ R_cam_from_world.T
    root = root + np.array([0.0, 0.0, DISTANCE_M])
    trans = torch.as_tensor(root) - body.model.joints_template[0]
    valid = torch.ones(1, frames, dtype=torch.bool)
    return MotionState.of(R_local[None], trans[None], trans.new_zeros(1, 10), valid)


def _observed(body: Body, state: MotionState, rng: np.random.Generator) -> Observation:
    """Keypoints of one performance with a detector's noise."""
    xyz = body.positions(body.keypoints, state)[0].numpy()
    xy = xyz[..., :2] / xyz[..., 2:] * K[0, 0] + K[:2, 2]
    xy = xy + rng.normal(0.0, NOISE_PX, xy.shape)
    return Observation(xy, np.ones(xy.shape[:2]), K, FPS, noise_share=NOISE_SHARE)


def _smooth(shape: tuple[int, ...], rng: np.random.Generator) -> Float[np.ndarray, "T ..."]:
    """Noise of unit variance along the first axis, smooth over about a third of a second."""
    noise = gaussian_filter1d(rng.normal(size=shape), SMOOTH_FRAMES, axis=0, mode="reflect")
    return noise * np.sqrt(2 * SMOOTH_FRAMES * np.sqrt(np.pi))


# Adam, the gradient descent that the paper names, for comparison with Gauss-Newton.

FIRST, SECOND, TINY = 0.9, 0.999, 1e-8


def adam(
    terms: Sequence[Term],
    state: MotionState,
    *,
    max_steps: int,
    learning_rate: float = 0.01,
    shared_globals: bool = False,
) -> Solution:
    """Adam (Kingma & Ba, 2015) on local increments; the best of all states is returned.

    The increments start again from the current state at every step, so rotations stay on their
    manifold; the moments are in the axes of each joint.

    Args:
        terms: the objective; state: the start.
        max_steps: steps, each with one gradient.
        learning_rate: of the increments, radians and metres.
        shared_globals: one body for the batch.
    """
    batch, frames = state.valid.shape
    trans = state.trans
    sizes = ((batch, frames, FRAME_UNKNOWNS), (batch, state.unknown_globals))
    first = [trans.new_zeros(size) for size in sizes]
    second = [trans.new_zeros(size) for size in sizes]
    best, best_cost, costs = state, float("inf"), []
    for step in range(1, max_steps + 2):
        zero = [trans.new_zeros(size).requires_grad_() for size in sizes]
        cost = objective(terms, state.retract(*zero)).sum()
        costs.append(float(cost.detach()))
        if costs[-1] < best_cost:
            best, best_cost = state, costs[-1]
        if step > max_steps:
            break
        gradients = list(torch.autograd.grad(cost, zero, allow_unused=True, materialize_grads=True))
        if shared_globals:
            gradients[1] = gradients[1].sum(0, keepdim=True).expand_as(gradients[1])
        moves = []
        for k, gradient in enumerate(gradients):
            first[k] = FIRST * first[k] + (1 - FIRST) * gradient
            second[k] = SECOND * second[k] + (1 - SECOND) * gradient.square()
            mean = first[k] / (1 - FIRST**step)
            spread = (second[k] / (1 - SECOND**step)).sqrt()
            moves.append(-learning_rate * mean / (spread + TINY))
        state = state.retract(*moves)
    status = f"Adam stopped after {max_steps} steps at its lowest objective"
    done = torch.zeros(batch, dtype=torch.bool, device=trans.device)
    return Solution(best, costs, done, status)


# L-BFGS, a general quasi-Newton method, for comparison with Gauss-Newton.

MEMORY = 20  # pairs of steps and gradients that approximate the curvature
STEPS_A_CENTRE = 100  # before the increments start again from the current state
SETTLED, MORE, STUCK = 0, 1, 2  # how SciPy's L-BFGS-B ends


def lbfgs(
    terms: Sequence[Term],
    state: MotionState,
    *,
    max_steps: int,
    relative_tolerance: float = 1e-6,
    shared_globals: bool = False,
) -> Solution:
    """L-BFGS (Liu & Nocedal, 1989) on local increments, with a strong Wolfe line search.

    Only points that lower the objective are taken, so it never rises. The increments are about
    one state for `STEPS_A_CENTRE` steps, then about the state reached: rotations stay far from the
    end of their chart, and the memory of the curvature starts again. It also starts again when a
    line search fails, as it can where a term's gradient is not exact (unknowns that a term
    minimises out are held constant in it).

    Args:
        terms: the objective; state: the start.
        max_steps: accepted steps at most.
        relative_tolerance: it has converged when a step lowers the objective by less than this
            share.
        shared_globals: one body for the batch.
    """
    costs, ended, moved = [float(objective(terms, state).sum())], MORE, True
    while ended != SETTLED and moved and len(costs) <= max_steps:
        chart = _Chart(terms, state, shared_globals)
        most = min(STEPS_A_CENTRE, max_steps + 1 - len(costs))
        state, lower, ended = _run(chart, costs[-1], most, relative_tolerance)
        costs += lower
        moved = bool(lower)
    steps = len(costs) - 1
    status = {
        SETTLED: f"L-BFGS converged after {steps} steps",
        MORE: f"L-BFGS stopped after {steps} steps before it converged",
        STUCK: f"L-BFGS stopped after {steps} steps, where its line search found nothing lower",
    }[ended]
    converged = torch.full_like(state.valid[:, 0], ended == SETTLED)
    return Solution(state, costs, converged, status)


@dataclass(frozen=True)
class _Chart:
    """The objective as a function of a flat vector: increments about a state."""

    terms: Sequence[Term]
    centre: MotionState
    shared_globals: bool

    @property
    def sizes(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Shapes of the frames' unknowns and of the globals."""
        batch, frames = self.centre.valid.shape
        rows = 1 if self.shared_globals else batch
        return (batch, frames, FRAME_UNKNOWNS), (rows, self.centre.unknown_globals)

    def state(self, x: Float[Tensor, " n"]) -> MotionState:
        """The centre after increments."""
        of_frames, of_globals = self.sizes
        count = int(np.prod(of_frames))
        d_globals = x[count:].reshape(of_globals).expand(len(self.centre.valid), -1)
        return self.centre.retract(x[:count].reshape(of_frames), d_globals)

    def tensor(self, x: Float[np.ndarray, " n"]) -> Float[Tensor, " n"]:
        """On the centre's device, in its dtype."""
        return torch.as_tensor(x).to(self.centre.trans)

    def value(self, x: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
        """The objective and its gradient; a very high value without slope where it is not
        finite."""
        point = self.tensor(x).requires_grad_()
        cost = objective(self.terms, self.state(point)).sum()
        (gradient,) = torch.autograd.grad(cost, point)
        if not (bool(cost.isfinite()) and bool(gradient.isfinite().all())):
            return float(np.finfo(np.float32).max), np.zeros_like(x)
        return float(cost.detach()), gradient.cpu().numpy().astype(np.float64)


def _run(
    chart: _Chart, start_cost: float, most: int, tolerance: float
) -> tuple[MotionState, list[float], int]:
    """The lowest state of up to ``most`` steps about one centre, the objective after each, and
    SciPy's exit code."""
    best = np.zeros(sum(int(np.prod(size)) for size in chart.sizes))
    costs = [start_cost]

    def taken(intermediate_result: OptimizeResult) -> None:
        nonlocal best
        if intermediate_result.fun < costs[-1]:
            best = np.array(intermediate_result.x)
            costs.append(float(intermediate_result.fun))

    ended = minimize(
        chart.value,
        best,
        jac=True,
        method="L-BFGS-B",
        callback=taken,
        options={
            "maxiter": most,
            "maxfun": 20 * most,
            "maxcor": MEMORY,
            "ftol": tolerance,
            "gtol": 0.0,
        },
    )
    return chart.state(chart.tensor(best)), costs[1:], int(ended.status)


# Gauss-Newton against its rivals on one objective, from one start, on one core.
#
# The objective is that of the motion common to all videos, with its cameras, at its first and
# widest robust scale: once for performances that are rigid copies, once with a rigid offset per
# frame. Every solver gets it as a single term that watches the clock, so all are timed in the same
# way: by the processor time of this process until a point no higher than the target has been
# evaluated.

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
    cameras = cameras_from_motion(scene, state, scene.K.to(state.trans))
    keypoints = common_motion.with_initial_offsets(scene) if rigid_offsets else scene.keypoints
    motion = consensus_motion(scene, state, cameras)
    free = [v for v in range(len(scene.observations)) if v != scene.reference]
    scale = scene.fit.robust_scale_sigma * common_motion.ROBUST_STAGES[0]
    views = common_motion.CommonViews(scene.body, keypoints, cameras, scale)
    image, start = common_motion.common_problem(views, motion, common_motion.Unknowns(free))
    return [*image, *scene.regularisers], start


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

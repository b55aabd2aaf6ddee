"""The hands of several videos: initial wrists, the descent, the common hand and every video's own.

Initial wrist rotations: many starts in single frames, and the cheapest smooth path of them. A
body's keypoints hardly determine how a forearm is twisted, so the hand may begin half a turn away
from its keypoints, where no small step leads. Every few frames the fit is tried from a set of
rotations, each frame by itself; the path with the lowest sum of objectives and rotation speeds is
the initial state of the fit over time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from imocap_core.hands.hand_objective import (
    ROTATIONS,
    ArmsAndHands,
    CommonHand,
    HandState,
    HandViews,
    HandWeights,
    common_at,
    common_views,
    coupling_cost,
    fps_of,
    image_cost,
    per_video_views,
    prior_cost,
    smooth_cost,
)
from imocap_core.hands.hand_skeleton import HandSkeleton, hand_points, joint_vectors
from imocap_core.motion.gauss_newton import descend
from imocap_core.motion.multiview.timeline import Timeline, sample, sample_rotations
from imocap_core.motion.normal import NormalEquations, solve_globals
from imocap_core.rotations import exp, geodesic_angle

USUAL = HandWeights()
TOLERANCE = 1e-4  # a step that lowers the objective by a smaller share is the last
SIZE_RANGE = (0.7, 1.4)
LARGEST_GROWTH = 0.2  # of the logarithm of the size in one step


@dataclass(frozen=True)
class HandProblem:
    """Everything that stays fixed during a fit.

    Attributes:
        skeleton: gives the ranges of motion; fps: (B,) frames a second.
        common: the hand motion that the hands are coupled to, or None.
    """

    views: HandViews
    skeleton: HandSkeleton
    weights: HandWeights
    fps: Float[Tensor, " B"]
    common: CommonHand | None = None

    def cost(self, state: HandState, normal: NormalEquations | None = None) -> Float[Tensor, " B"]:
        """The objective; adds its linearisation to ``normal``."""
        views, weights = self.views, self.weights
        total = image_cost(views, state, weights, normal)
        total = total + prior_cost(views, state, self.skeleton, weights, normal)
        total = total + smooth_cost(views, state, weights, self.fps, normal)
        if self.common is not None:
            total = total + coupling_cost(views, state, self.common, weights, normal)
        return total


def _solve_hands(
    problem: HandProblem, state: HandState, max_steps: int
) -> tuple[HandState, Float[Tensor, " B"]]:
    """Hands of known size: the state of lowest objective, and the objective.

    Every hand of the batch is accepted or rejected by itself, so no objective ever rises.
    """
    descent = descend(_EachHand(problem), state, max_steps=max_steps, tolerance=TOLERANCE)
    return descent.state, torch.as_tensor(descent.costs[-1]).to(state.angles)


def _solve_hands_and_size(
    problem: HandProblem, state: HandState, max_steps: int, size_spread: float
) -> HandState:
    """Hands and the one size of all of them; size_spread: of its logarithm about 0."""
    together = _OneSize(problem, size_spread)
    return descend(together, state, max_steps=max_steps, tolerance=TOLERANCE).state


def linearise(problem: HandProblem, state: HandState) -> NormalEquations:
    """The normal equations at a state, the size its one global; padded frames get an identity."""
    batch, frames = problem.views.valid.shape
    unknowns = ROTATIONS + 3 * state.offset_m.shape[2]
    normal = NormalEquations.zeros(batch, frames, unknowns, 1, state.angles)
    problem.cost(state, normal)
    padding = (~problem.views.valid)[..., None].to(state.angles)
    torch.diagonal(normal.diagonal, dim1=-2, dim2=-1).add_(padding)
    return normal


@dataclass(frozen=True)
class _EachHand:
    """Hands of known size, a row of the descent each."""

    problem: HandProblem

    def cost(self, state: HandState) -> Float[np.ndarray, " B"]:
        """The objective of each hand."""
        return self.problem.cost(state).cpu().numpy()

    def linearise(self, state: HandState) -> NormalEquations:
        """The normal equations of all hands."""
        return linearise(self.problem, state)

    def trial(
        self, state: HandState, equations: NormalEquations, damping: Float[np.ndarray, " B"]
    ) -> HandState:
        """The hands after the damped step of their frames, the size held."""
        factor = torch.as_tensor(damping).to(state.angles)[:, None, None]
        if equations.diagonal.shape[1] == 1:  # single frames: all in one product
            damped = equations.diagonal.clone()
            diagonal = torch.diagonal(damped, dim1=-2, dim2=-1)
            diagonal.add_(factor * diagonal)
            return state.retract(-torch.linalg.solve(damped, equations.gradient))
        held = equations.gradient.new_zeros(len(damping), 1)
        return state.retract(equations.reduce(factor).frames(held).nan_to_num())

    def choose(
        self, better: Bool[np.ndarray, " B"], trial: HandState, state: HandState
    ) -> HandState:
        """The hands that came down, the others as they were."""
        return trial.where(torch.as_tensor(better, device=state.angles.device), state)


@dataclass(frozen=True)
class _OneSize:
    """All hands and their common size, as the one row of a descent."""

    problem: HandProblem
    size_spread: float

    def cost(self, state: HandState) -> Float[np.ndarray, "1"]:
        """Sum of the hands' objectives and what the size costs."""
        of_size = (math.log(state.size) / self.size_spread) ** 2
        return np.array([float(self.problem.cost(state).sum()) + of_size])

    def linearise(self, state: HandState) -> NormalEquations:
        """The normal equations of all hands, the size's prior among them."""
        normal = linearise(self.problem, state)
        normal.corner[0] += 1 / self.size_spread**2
        normal.corner_gradient[0] += math.log(state.size) / self.size_spread**2
        return normal

    def trial(
        self, state: HandState, equations: NormalEquations, damping: Float[np.ndarray, "1"]
    ) -> HandState:
        """All hands and the size after the damped step."""
        factor = float(damping[0])
        reduced = equations.reduce(factor)
        growth = solve_globals([reduced], factor)
        step = reduced.frames(growth.expand(len(self.problem.fps), 1)).nan_to_num()
        log_factor = float(growth.clamp(-LARGEST_GROWTH, LARGEST_GROWTH))
        size = min(max(state.size * math.exp(log_factor), SIZE_RANGE[0]), SIZE_RANGE[1])
        return replace(state.retract(step), size=size)

    def choose(
        self, better: Bool[np.ndarray, "1"], trial: HandState, state: HandState
    ) -> HandState:
        """All hands are accepted or rejected together."""
        return trial if better[0] else state


_TWISTS_DEG, _BENDS_DEG = (-120, -60, 0, 60, 120, 180), (-45, 45)
_SPEED_RAD_S = 3.0  # rotation speed of a wrist that costs 1
_STEPS = 8
_AT_ONCE = 16  # frames: bounds the memory of long videos


def _wrist_starts() -> Float[Tensor, "H 3 3"]:
    """Rotations of a hand against the body's: about the forearm, then at the wrist."""
    angles = [(t, b) for t in _TWISTS_DEG for b in _BENDS_DEG]
    radians = torch.deg2rad(torch.tensor(angles, dtype=torch.float64))
    zero = torch.zeros_like(radians[:, 0])
    twist = torch.stack([radians[:, 0], zero, zero], -1)  # forearms lie along x at rest
    bend = torch.stack([zero, zero, radians[:, 1]], -1)
    return exp(twist) @ exp(bend)


def _initial_state(problem: HandProblem, stride_s: float) -> HandState:
    """A state near the keypoints for all frames of a problem."""
    frames = problem.views.valid.shape[1]
    stride = max(1, round(stride_s * float(problem.fps.min())))
    chosen = np.unique(np.append(np.arange(0, frames, stride), frames - 1))
    parts = [
        _tried(problem, torch.as_tensor(chosen[k : k + _AT_ONCE], device=problem.fps.device))
        for k in range(0, len(chosen), _AT_ONCE)
    ]
    all_R, all_angles, all_offsets, cost = (
        torch.cat(each, dim=1) for each in zip(*parts, strict=True)
    )
    count = len(chosen)
    paths: list[tuple[Tensor, Tensor, Tensor]] = []
    for b, R in enumerate(all_R):
        seconds = np.diff(chosen) / float(problem.fps[b])
        best = cheapest_path(cost[b], R, seconds)
        pick = torch.arange(count, device=best.device), best
        position = np.interp(np.arange(frames), chosen, np.arange(count))
        paths.append(
            (
                sample_rotations(R[pick][:, None], position)[:, 0],
                sample(all_angles[b][pick], position),
                sample(all_offsets[b][pick], position),
            )
        )
    R_wrist, angles, offset_m = (torch.stack(part) for part in zip(*paths, strict=True))
    return HandState(R_wrist, angles, offset_m)


def _tried(problem: HandProblem, frames: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Every rotation in each of N frames by itself: R_wrist (B, N, H, 3, 3), angles (B, N, H, 21),
    offsets (B, N, H, V, 3) and objectives (B, N, H)."""
    few = problem.views.frames(frames)
    rotations = _wrist_starts().to(problem.fps)
    alone = few.single_frames(len(rotations))
    shape = (*few.valid.shape, len(rotations))
    start = HandState(
        R_wrist=alone.R_body @ rotations.repeat(few.valid.numel(), 1, 1)[:, None],
        angles=alone.R_body.new_zeros(len(alone.valid), 1, 21),
        offset_m=torch.zeros_like(alone.wrist_m),
    )
    fps = problem.fps.new_ones(len(alone.valid))
    each = replace(problem, views=alone, fps=fps, common=None)
    state, cost = _solve_hands(each, start, _STEPS)
    return (
        state.R_wrist.reshape(*shape, 3, 3),
        state.angles.reshape(*shape, -1),
        state.offset_m.reshape(*shape, -1, 3),
        cost.reshape(shape),
    )


def cheapest_path(
    cost: Float[Tensor, "N H"], R: Float[Tensor, "N H 3 3"], seconds: Float[np.ndarray, " _"]
) -> Int[Tensor, " N"]:
    """Candidate of each frame, by the lowest sum of costs and of squared rotation speeds.

    Args:
        cost: of H candidates a frame; R: their rotations; seconds: (N - 1,) between frames.
    """
    total, back = cost[0], list[Tensor]()
    for n in range(1, len(cost)):
        angle = geodesic_angle(R[n - 1][:, None], R[n][None])
        ways = total[:, None] + (angle / (_SPEED_RAD_S * float(seconds[n - 1]))) ** 2
        least, origin = ways.min(0)
        total, back = cost[n] + least, [*back, origin]
    path = [int(total.argmin())]
    for origin in reversed(back):
        path.append(int(origin[path[-1]]))
    return torch.tensor(path[::-1], device=cost.device)


@dataclass(frozen=True)
class FittedHands:
    """One video's hands, left then right.

    Attributes:
        finger_vectors: (T, 2, 15, 3) axis-angle radians in SMPL+H's order.
        R_wrist: (T, 2, 3, 3) rotation of the hand against the forearm.
        points_m: (T, 2, 21, 3) in camera axes, OpenPose's order.
        visible: (T, 2) whether any keypoint of the hand is used.
    """

    finger_vectors: Float[Tensor, "T 2 15 3"]
    R_wrist: Float[Tensor, "T 2 3 3"]
    points_m: Float[Tensor, "T 2 21 3"]
    visible: Bool[Tensor, "T 2"]


def fit_hands(
    skeleton: HandSkeleton,
    videos: Sequence[ArmsAndHands],
    timeline: Timeline | None,
    reference: int,
    params: HandWeights = USUAL,
) -> tuple[list[FittedHands], float]:
    """Fit both hands in all videos of one action; returns them and their common size.

    Args:
        videos: at least one; timeline: their correspondences, None for a video by itself.
        reference: index of the video whose frames the timeline counts.

    Raises:
        ValueError: several videos without a timeline.
    """
    if timeline is None and len(videos) != 1:
        raise ValueError(f"timeline: expected one for {len(videos)} videos, got none")
    common = None if timeline is None else _common(skeleton, videos, timeline, reference, params)
    views = per_video_views(skeleton, videos)
    problem = HandProblem(views, skeleton, params, fps_of(videos))
    if common is None or timeline is None:
        state = _solved(problem, _initial_state(problem, params.stride_s), params)
    else:
        target = common_at(common, videos, timeline)
        problem = replace(problem, common=target)
        no_offset = torch.zeros_like(views.wrist_m)
        state = HandState(target.R_wrist, target.angles, no_offset, common.size)
        state, _ = _solve_hands(problem, state, params.max_steps)
    return _by_video(problem, state, videos), state.size


def _common(
    skeleton: HandSkeleton,
    videos: Sequence[ArmsAndHands],
    timeline: Timeline,
    reference: int,
    params: HandWeights,
) -> HandState:
    """One left and one right hand for all videos, at the reference's frames."""
    views = common_views(skeleton, videos, timeline)
    fps = views.K.new_full((2,), videos[reference].fps)
    problem = HandProblem(views, skeleton, params, fps)
    return _solved(problem, _initial_state(problem, params.stride_s), params)


def _solved(problem: HandProblem, state: HandState, params: HandWeights) -> HandState:
    state, _ = _solve_hands(problem, state, params.max_steps)
    return _solve_hands_and_size(problem, state, params.max_steps, params.size_spread)


def _by_video(
    problem: HandProblem, state: HandState, videos: Sequence[ArmsAndHands]
) -> list[FittedHands]:
    views = problem.views
    bones, axes = views.bones[:, None] * state.size, views.axes[:, None]
    local, _, _ = hand_points(bones, axes, state.R_wrist, state.angles)
    place = (views.wrist_m + state.offset_m)[:, :, 0, None]
    points = (views.R_forearm[:, :, 0, None] @ local[..., None])[..., 0] + place
    vectors = joint_vectors(axes, state.angles).flatten(-3, -2)
    hands = []
    for v, video in enumerate(videos):
        used = slice(0, video.frames)
        rows = slice(2 * v, 2 * v + 2)
        fingers, wrist, xyz = (
            x[rows, used].transpose(0, 1) for x in (vectors, state.R_wrist, points)
        )
        hands.append(FittedHands(fingers, wrist, xyz, video.visible.T))
    return hands

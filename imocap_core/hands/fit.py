"""The hands of several videos: first the hand that is common to all, then every video's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from imocap_core.hands.assemble import (
    VideoHands,
    common_at,
    common_views,
    fps_of,
    own_views,
)
from imocap_core.hands.kinematics import hand_points, joint_vectors
from imocap_core.hands.problem import HandState
from imocap_core.hands.skeleton import HandSkeleton
from imocap_core.hands.solver import HandProblem, solve_hands, solve_hands_and_size
from imocap_core.hands.starts import started
from imocap_core.motion.multiview.timeline import Timeline
from imocap_core.params import HandsParams


@dataclass(frozen=True)
class FittedHands:
    """One video's hands, left then right.

    Attributes:
        finger_vectors: (T, 2, 15, 3) axis-angle radians in SMPL+H's order.
        R_wrist: (T, 2, 3, 3) rotation of the hand against the forearm.
        points_m: (T, 2, 21, 3) in camera axes, OpenPose's order.
        seen: (T, 2) bool.
    """

    finger_vectors: Tensor
    R_wrist: Tensor
    points_m: Tensor
    seen: Tensor


def fit_hands(
    skeleton: HandSkeleton,
    videos: Sequence[VideoHands],
    timeline: Timeline | None,
    reference: int,
    params: HandsParams,
) -> tuple[list[FittedHands], float]:
    """Fit both hands in all videos that show one action; returns them and their common size.

    Args:
        videos: at least one. timeline: of these very videos, None for a video by itself.
        reference: index of the video whose frames the timeline counts.
    """
    if timeline is None and len(videos) != 1:
        raise ValueError(f"timeline: expected one for {len(videos)} videos, got none")
    common = None if timeline is None else _common(skeleton, videos, timeline, reference, params)
    views = own_views(skeleton, videos)
    problem = HandProblem(views, skeleton, params, fps_of(videos))
    if common is None or timeline is None:
        state = _solved(problem, started(problem, params.stride_s), params)
    else:
        shared = common_at(common, videos, timeline)
        problem = replace(problem, common=shared)
        still = torch.zeros_like(views.wrist_m)
        state = HandState(shared.R_wrist, shared.angles, still, common.size)
        state, _ = solve_hands(problem, state, params.max_steps)
    return _parted(problem, state, videos), state.size


def _common(
    skeleton: HandSkeleton,
    videos: Sequence[VideoHands],
    timeline: Timeline,
    reference: int,
    params: HandsParams,
) -> HandState:
    """One left and one right hand for all videos, on the reference's frames."""
    views = common_views(skeleton, videos, timeline)
    fps = views.K.new_full((2,), videos[reference].fps)
    problem = HandProblem(views, skeleton, params, fps)
    return _solved(problem, started(problem, params.stride_s), params)


def _solved(problem: HandProblem, state: HandState, params: HandsParams) -> HandState:
    state, _ = solve_hands(problem, state, params.max_steps)
    return solve_hands_and_size(problem, state, params.max_steps, params.size_spread)


def _parted(
    problem: HandProblem, state: HandState, videos: Sequence[VideoHands]
) -> list[FittedHands]:
    views = problem.views
    bones, axes = views.bones[:, None] * state.size, views.axes[:, None]
    local, _, _ = hand_points(bones, axes, state.R_wrist, state.angles)
    place = (views.wrist_m + state.offset_m)[:, :, 0, None]
    points = (views.R_forearm[:, :, 0, None] @ local[..., None])[..., 0] + place
    vectors = joint_vectors(axes, state.angles).flatten(-3, -2)
    found = []
    for v, video in enumerate(videos):
        used = slice(0, video.frames)
        mine = slice(2 * v, 2 * v + 2)
        fingers, wrist, xyz = (
            x[mine, used].transpose(0, 1) for x in (vectors, state.R_wrist, points)
        )
        found.append(FittedHands(fingers, wrist, xyz, video.seen.T))
    return found

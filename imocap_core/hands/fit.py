"""The hands of several videos: first the hand common to all, then every video's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from imocap_core.hands.assemble import (
    ArmsAndHands,
    common_at,
    common_views,
    fps_of,
    per_video_views,
)
from imocap_core.hands.kinematics import hand_points, joint_vectors
from imocap_core.hands.skeleton import HandSkeleton
from imocap_core.hands.solver import HandProblem, solve_hands, solve_hands_and_size
from imocap_core.hands.starts import initial_state
from imocap_core.hands.state import HandState
from imocap_core.motion.multiview.timeline import Timeline
from imocap_core.params import HandsParams


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
    params: HandsParams,
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
        state = _solved(problem, initial_state(problem, params.stride_s), params)
    else:
        target = common_at(common, videos, timeline)
        problem = replace(problem, common=target)
        no_offset = torch.zeros_like(views.wrist_m)
        state = HandState(target.R_wrist, target.angles, no_offset, common.size)
        state, _ = solve_hands(problem, state, params.max_steps)
    return _by_video(problem, state, videos), state.size


def _common(
    skeleton: HandSkeleton,
    videos: Sequence[ArmsAndHands],
    timeline: Timeline,
    reference: int,
    params: HandsParams,
) -> HandState:
    """One left and one right hand for all videos, at the reference's frames."""
    views = common_views(skeleton, videos, timeline)
    fps = views.K.new_full((2,), videos[reference].fps)
    problem = HandProblem(views, skeleton, params, fps)
    return _solved(problem, initial_state(problem, params.stride_s), params)


def _solved(problem: HandProblem, state: HandState, params: HandsParams) -> HandState:
    state, _ = solve_hands(problem, state, params.max_steps)
    return solve_hands_and_size(problem, state, params.max_steps, params.size_spread)


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

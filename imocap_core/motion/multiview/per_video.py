"""From the common motion to every video's own deviation from it."""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from imocap_core.motion.multiview.aligned import root_positions
from imocap_core.motion.multiview.cameras import Cameras
from imocap_core.motion.multiview.coupling import (
    CouplingTargets,
    coupling_terms,
    position_coupling,
    to_video_axes,
    to_video_frames,
)
from imocap_core.motion.multiview.deviation import joint_spread_rad, pooled_spread_m
from imocap_core.motion.multiview.facing import FACING_RAD, facing_agreement, turned_by
from imocap_core.motion.multiview.scene import (
    DeviationSpread,
    Scene,
    correlation_frames,
    per_video_terms,
    solve,
)
from imocap_core.motion.observations import place_variance
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms import FootContact, Term
from imocap_core.motion.terms.foot_contact import foot_contact_share
from imocap_core.params import MotionParams

# Foot speeds at which contact counts a quarter: in the common motion, and in one video's own.
COMMON_CONTACT_M_S, VIDEO_CONTACT_M_S = 0.05, 0.2
# Of the weight that rotations would have alone: the positions couple the same deviations.
ROTATIONS_SHARE = 0.5
CONTACT_SCALE = 4.0  # square root of the largest cost of a step of a foot in contact


def fit_deviations(
    scene: Scene,
    state: MotionState,
    common: MotionState,
    cameras: Cameras,
    spread: DeviationSpread,
    options: MotionParams,
    *,
    afresh: bool = True,
) -> tuple[MotionState, float]:
    """Fit each video to its own image evidence, coupled to the common motion.

    Args:
        state: every video's motion so far, in its own camera's axes.
        common: batch of 1, world axes; spread: sets the coupling's strength.
        afresh: start at the common motion; else at ``state``, a result of this function.

    Returns:
        Every video's motion, and the objective.
    """
    targets = targets_of(scene, state, common, cameras)
    faces = facing_agreement(scene, state, targets)
    carried = common_at_video_frames(scene, state, common, cameras)
    carried = _facing_released(carried, state, faces)
    start = carried
    if not afresh:
        astray = (turned_by(state, targets) > FACING_RAD) & (faces > 0.5)
        start = _replaced(replace(state, betas=carried.betas), carried, astray)
    terms = [*per_video_terms(scene, start.trans), foot_contact_term(scene, carried, state)]
    terms += deviation_terms(scene, carried, common, cameras, spread, options, faces)
    solution = solve(terms, start, options.max_steps, performers=scene.performers)
    return solution.state, solution.costs[-1]


def deviation_terms(
    scene: Scene,
    start: MotionState,
    common: MotionState,
    cameras: Cameras,
    spread: DeviationSpread,
    options: MotionParams,
    faces: Float[Tensor, "B T"],
) -> list[Term]:
    """Coupling to the common motion, a deviation counted once per correlation time.

    Args:
        start: the common motion at every video's own frames; unmatched frames need no target.
        faces: weight of the root orientation's coupling (`facing_agreement`).
    """
    targets = targets_of(scene, start, common, cameras)
    joints = joint_spread_rad(scene.body, common, spread.keypoints_m)
    joints[:, :, 0] = spread.offset_sd[:, None, 0]
    frames = correlation_frames(options, scene.fps)
    at_reference = torch.as_tensor(1 / (joints**2 * frames)).to(start.trans)
    at_reference[..., 1:] *= ROTATIONS_SHARE
    joint_weight = to_video_frames(at_reference, scene.timeline, start)
    joint_weight[..., 0] *= faces
    variance = torch.as_tensor(spread.offset_sd[:, 3:4] ** 2).to(start.trans)
    path_weight = 1 / ((variance + place_variance(scene.observations, start.trans)) * frames)
    of_positions = 1 / (pooled_spread_m(spread.keypoints_m) ** 2 * frames)
    position_weight = to_video_frames(
        torch.as_tensor(of_positions).to(start.trans), scene.timeline, start
    )
    return [
        *coupling_terms(scene.body, targets, start, joint_weight, path_weight),
        position_coupling(scene.body, targets, start, position_weight),
    ]


def foot_contact_term(scene: Scene, common: MotionState, state: MotionState) -> Term:
    """Hold feet that are in contact with the ground in the common motion and in the video's own.

    Args:
        common: the common motion at every video's own frames; state: every video's own motion.
    """
    weight = (scene.fps / scene.fit.foot_hold_m_s) ** 2
    in_common = foot_contact_share(scene.body, common, scene.fps, speed_m_s=COMMON_CONTACT_M_S)
    in_video = foot_contact_share(scene.body, state, scene.fps, speed_m_s=VIDEO_CONTACT_M_S)
    return FootContact(scene.body, weight * in_common * in_video, CONTACT_SCALE)


def _facing_released(start: MotionState, state: MotionState, faces: Tensor) -> MotionState:
    """The start with the video's own root orientation where it faces another way."""
    R_local = start.R_local.clone()
    other_way = (faces < 0.25)[..., None, None]
    R_local[:, :, 0] = torch.where(other_way, state.R_local[:, :, 0], R_local[:, :, 0])
    return replace(start, R_local=R_local)


def _replaced(state: MotionState, by: MotionState, where: Bool[Tensor, "B T"]) -> MotionState:
    """The state with another's poses and translations in some frames."""
    return replace(
        state,
        R_local=torch.where(where[..., None, None, None], by.R_local, state.R_local),
        trans=torch.where(where[..., None], by.trans, state.trans),
    )


def common_at_video_frames(
    scene: Scene, state: MotionState, common: MotionState, cameras: Cameras
) -> MotionState:
    """The common motion at every video's matched frames; unmatched ones stay as in ``state``."""
    targets = targets_of(scene, state, common, cameras)
    matched = (targets.trust > 0)[..., None]
    betas = torch.cat([common.of_performer(p).betas for p in scene.performers])
    rest = scene.body.model.shape(betas).joints_rest[:, 0]
    return replace(
        state,
        R_local=torch.where(matched[..., None, None], targets.R_local, state.R_local),
        trans=torch.where(matched, targets.root - rest[:, None], state.trans),
        betas=betas,
    )


def targets_of(
    scene: Scene, state: MotionState, common: MotionState, cameras: Cameras
) -> CouplingTargets:
    """The common motion at every video's frames and in its camera's axes."""
    videos = len(scene.observations)
    Z = common.R_local.expand(videos, -1, -1, -1, -1)
    paths = [root_positions(scene.body, common.of_performer(p)) for p in scene.performers]
    Y = torch.cat(paths)
    return to_video_axes(Z, Y, cameras, scene.timeline, scene.confidences, state)

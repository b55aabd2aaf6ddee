"""From the common motion to every video's own deviation from it.

Each video is fitted to its own image evidence, coupled to the common motion: strongly where videos
agree, weakly where they do not.

A performer may face another side for a while, and then the video's root orientation must not follow
the common motion. But a monocular fit may also take the back for the front, or reverse depth, and
then the same difference of root orientations is an error that the common motion repairs. The
keypoints tell one from the other: with the common articulation, the root orientation that is right
explains them better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from imocap_core.motion.monocular.fit import monocular_terms
from imocap_core.motion.multiview.scene import (
    Cameras,
    DeviationSpread,
    Scene,
    correlation_frames,
    nearest_true,
    root_positions,
    solve,
)
from imocap_core.motion.multiview.timeline import Timeline, sample, sample_rotations
from imocap_core.motion.observations import per_video_view, place_variance
from imocap_core.motion.state import Body, MotionState
from imocap_core.motion.terms import (
    FootContact,
    JointEvidence,
    PathCoupling,
    PoseCoupling,
    Term,
    View,
)
from imocap_core.motion.terms.base import running_mean
from imocap_core.motion.terms.contact import foot_contact_share
from imocap_core.motion.terms.view import project
from imocap_core.params import MotionParams
from imocap_core.robust import geman_mcclure_weight
from imocap_core.rotations import geodesic_angle

# The keypoints whose positions are coupled; every layout of a body has them.
COUPLED = frozenset(
    f"{side}_{joint}"
    for side in ("left", "right")
    for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
) | {"nose"}

UNBOUNDED = 1e3  # Geman-McClure scale: no deviation is an outlier


@dataclass(frozen=True)
class CouplingTargets:
    """What each video is coupled to, in its own camera's axes and at its own frames.

    Attributes:
        R_local: (B, T, 24, 3, 3); root: (B, T, 3) metres, the root joint.
        trust: (B, T) confidence of the match, 0 for frames without one.
        shifts: (B, T, K, 3) metres, of the keypoints by the modes of variation, or None.
    """

    R_local: Float[Tensor, "B T 24 3 3"]
    root: Float[Tensor, "B T 3"]
    trust: Float[Tensor, "B T"]
    shifts: Float[Tensor, "B T K 3"] | None = None


def to_video_axes(
    Z: Float[Tensor, "M N 24 3 3"],
    Y: Float[Tensor, "M N 3"],
    cameras: Cameras,
    timeline: Timeline,
    confidences: Sequence[Float[np.ndarray, " _"]],
    state: MotionState,
) -> CouplingTargets:
    """World targets at each video's own frames and in its own camera's axes.

    Args:
        state: stands in for the targets of padded frames.
    """
    R_local, path = state.R_local.clone(), state.trans.clone()
    trust = state.trans.new_zeros(state.valid.shape)
    for v, position in enumerate(timeline.to_reference):
        matched, length = np.isfinite(position), len(position)
        filled = position
        if matched.any():
            filled = np.interp(np.arange(length), np.nonzero(matched)[0], position[matched])
        R = sample_rotations(Z[v], filled)
        R[:, 0] = cameras.R[v] @ R[:, 0]
        R_local[v, :length] = R
        path[v, :length] = sample(Y[v], filled) @ cameras.R[v].T + cameras.t[v]
        trust[v, :length] = torch.as_tensor(np.where(matched, confidences[v], 0.0)).to(trust)
    return CouplingTargets(R_local, path, trust)


def coupling_terms(
    body: Body,
    targets: CouplingTargets,
    state: MotionState,
    joint_weight: Float[Tensor, "#B #T #24"],
    path_weight: Float[Tensor, "#B #T"],
) -> list[Term]:
    """Eq. 8's two coupling terms.

    Args:
        joint_weight: 1/rad^2; path_weight: 1/m^2; both broadcast.
    """
    rest = body.model.shape(state.betas).joints_rest[:, 0]
    pose = (targets.trust[..., None] * joint_weight).expand(*targets.trust.shape, 24)
    return [
        PoseCoupling(targets.R_local, pose),
        PathCoupling(targets.root - rest[:, None], targets.trust * path_weight),
    ]


def position_coupling(
    body: Body, targets: CouplingTargets, state: MotionState, weight: Float[Tensor, "B T K"]
) -> JointEvidence:
    """Positions of the limbs' keypoints and the nose, coupled to the target's after the best
    rotation and shift of each frame.

    With rotations coupled one by one, the deviations of all joints above a hand add up. This
    correlates them: what they come to together is bounded (docs/decisions.md).

    Args:
        state: its shapes are the targets'; weight: of the layout's keypoints, 1/m^2.
    """
    names = body.keypoints.names  # of several layouts, where videos differ in them
    share = weight.new_tensor([(name in COUPLED) / names.count(name) for name in names])
    posed = replace(state, R_local=targets.R_local)
    xyz = body.positions(body.keypoints, posed).detach()
    xyz = xyz if targets.shifts is None else xyz + targets.shifts
    return JointEvidence(
        body, xyz, targets.trust[..., None] * weight * share, UNBOUNDED, of_keypoints=True
    )


def shifts_at_video_frames(
    scene: Scene, cameras: Cameras, spread: DeviationSpread, state: MotionState
) -> Float[Tensor, "B T K 3"] | None:
    """What the modes tell of each performance, in its camera's axes; 0 if unmatched."""
    if spread.shifts_m is None:
        return None
    turned = torch.as_tensor(spread.shifts_m).to(cameras.R) @ cameras.R.mT[:, None]
    return to_video_frames(turned.flatten(2), scene.timeline, state).unflatten(-1, (-1, 3))


def to_video_frames(
    at_reference: Float[Tensor, "M N J"], timeline: Timeline, state: MotionState
) -> Float[Tensor, "M T J"]:
    """Values at the reference's frames, at each video's own frames (nearest; 0 if unmatched)."""
    out = at_reference.new_zeros(*state.valid.shape, at_reference.shape[-1])
    for v, position in enumerate(timeline.to_reference):
        matched = np.isfinite(position)
        last = at_reference.shape[1] - 1
        nearest = np.clip(np.nan_to_num(position).round().astype(int), 0, last)
        index = torch.as_tensor(nearest, device=at_reference.device)
        values = at_reference[v, index] * torch.as_tensor(matched).to(at_reference)[:, None]
        out[v, : len(position)] = values
    return out


def targets_of(
    scene: Scene, state: MotionState, common: MotionState, cameras: Cameras
) -> CouplingTargets:
    """The common motion at every video's frames and in its camera's axes."""
    videos = len(scene.observations)
    Z = common.R_local.expand(videos, -1, -1, -1, -1)
    paths = [root_positions(scene.body, common.of_performer(p)) for p in scene.performers]
    Y = torch.cat(paths)
    return to_video_axes(Z, Y, cameras, scene.timeline, scene.confidences, state)


LEAST_SPREAD_M = (0.004, 0.01)  # of a keypoint: of performances that hardly differ, and of others
_LEAST_TURN_RAD_PER_M = 3.0  # the same of a joint: a limb's length away, a keypoint moves so far
LEAST_LEVER_M = 0.15

UNMOVED_SPREAD_RAD = 0.1  # of a joint that moves no keypoint


def pooled_spread_m(spread_m: Float[np.ndarray, "M N K"]) -> Float[np.ndarray, "M N K"]:
    """Spread of keypoints of which half the variance is that of all in the frame: the errors of one
    view tell little of a single keypoint's; at least `least_spread_m`."""
    variance = np.square(spread_m)
    pooled = np.sqrt((variance + variance.mean(axis=-1, keepdims=True)) / 2)
    return np.maximum(pooled, least_spread_m(spread_m))


def least_spread_m(spread_m: Float[np.ndarray, "M N K"]) -> float:
    """Smallest spread of a keypoint: the mean of all, within `LEAST_SPREAD_M`. What noise hides of
    a single keypoint's deviations is small where performances hardly differ as a whole."""
    return float(np.clip(spread_m.mean(), *LEAST_SPREAD_M))


def joint_spread_rad(
    body: Body, motion: MotionState, spread_m: Float[np.ndarray, "M N K"]
) -> Float[np.ndarray, "M N 24"]:
    """Standard deviation of each joint's rotation: the smallest bound that a keypoint sets.

    A keypoint at distance d below joint j that deviates by s metres rotates the joint by at most
    s/d; the smallest such bound over the keypoints that the joint moves is taken.

    Args:
        motion: the common one (batch of 1).
    """
    points = body.positions(body.keypoints, motion)[0]
    joints = body.positions(body.joints, motion)[0]
    lever = torch.cdist(joints, points).clamp_min(LEAST_LEVER_M).cpu().numpy()  # (N, 24, K)
    moved = body.keypoints.moved_by.T.cpu().numpy()  # (24, K)
    angle = spread_m[:, :, None] / lever[None]  # (M, N, 24, K)
    angle = np.where(moved, angle, np.inf).min(-1)
    angle[:, :, ~moved.any(1)] = UNMOVED_SPREAD_RAD
    return np.maximum(angle, _LEAST_TURN_RAD_PER_M * least_spread_m(spread_m))


def per_video_terms(scene: Scene, template: Tensor) -> list[Term]:
    """Every video's own image evidence and regularisers; template: gives dtype and device."""
    return monocular_terms(
        scene.body, scene.prior, scene.observations, template, scene.fit, scale=1.0
    )


FACING_RAD = 0.6  # beyond a monocular estimate's own errors
FACING_FRAMES = 7
EVIDENCE_FRAMES = 15  # over which the keypoints of single frames are averaged


def facing_agreement(
    scene: Scene, state: MotionState, targets: CouplingTargets
) -> Float[Tensor, "B T"]:
    """Weight of a performance's coupling to the common root orientation.

    The Geman-McClure weight of the angle between the two, averaged over `FACING_FRAMES` so that
    noise alone releases no root orientation; 1 where the keypoints speak for the common one.

    Args:
        state: every video's motion; targets: the common motion at its frames and in its axes.
    """
    faces = geman_mcclure_weight(turned_by(state, targets), FACING_RAD)
    return torch.where(refuted(scene, state, targets), torch.ones_like(faces), faces)


def turned_by(state: MotionState, targets: CouplingTargets) -> Float[Tensor, "B T"]:
    """Angle between a performance's root orientation and the common one, smoothed."""
    angle = geodesic_angle(state.R_local[:, :, 0], targets.R_local[:, :, 0])
    return _smoothed(angle, FACING_FRAMES)


def refuted(scene: Scene, state: MotionState, targets: CouplingTargets) -> Tensor:
    """(B, T) where the common root orientation explains the keypoints better than the video's."""
    view = per_video_view(scene.observations, state.trans)
    turned = targets.R_local.clone()
    turned[:, :, 0] = state.R_local[:, :, 0]
    residual, shared = (
        _smoothed(_unexplained(scene, view, replace(state, R_local=R)), EVIDENCE_FRAMES)
        for R in (turned, targets.R_local)
    )
    return shared < residual


def _unexplained(scene: Scene, view: View, state: MotionState) -> Float[Tensor, "B T"]:
    """Share of the keypoints' squared spread that a pose leaves under its best scale and shift."""
    pixels, _ = project(view, scene.body.positions(scene.body.keypoints, state))
    weight = view.weight[..., None]
    total = weight.sum(2, keepdim=True).clamp_min(1e-12)
    p, x = (q - (weight * q).sum(2, keepdim=True) / total for q in (pixels, view.xy_px))
    product, spread, size = ((weight * a * b).sum((2, 3)) for a, b in ((p, x), (p, p), (x, x)))
    explained = product.clamp_min(0.0).square() / (spread * size).clamp_min(1e-12)
    return torch.where(size > 0, 1.0 - explained, 0.0)


def _smoothed(values: Float[Tensor, "B T"], frames: int) -> Float[Tensor, "B T"]:
    """Centred mean of an odd number of frames."""
    return running_mean(values[:, None], frames // 2)[:, 0]


# Foot speeds at which contact counts a quarter: in the common motion, and in one video's own.
COMMON_CONTACT_M_S, VIDEO_CONTACT_M_S = 0.05, 0.2
# Of the weight that rotations would have alone: the positions couple the same deviations.
ROTATIONS_SHARE = 0.5
LOST_SHARE = 0.2  # of the keypoints' spread that a fit explained before and does not any more
CONTACT_SCALE = 4.0  # square root of the largest cost of a step of a foot in contact


def fit_deviations(
    scene: Scene,
    state: MotionState,
    common: MotionState,
    cameras: Cameras,
    spread: DeviationSpread,
    options: MotionParams,
    *,
    restart: bool = True,
) -> tuple[MotionState, float]:
    """Fit each video to its own image evidence, coupled to the common motion.

    Args:
        state: every video's motion so far, in its own camera's axes.
        common: batch of 1, world axes; spread: sets the coupling's strength.
        restart: start at the common motion; else at ``state``, a result of this function.

    Returns:
        Every video's motion, and the objective.
    """
    targets = targets_of(scene, state, common, cameras)
    targets = replace(targets, shifts=shifts_at_video_frames(scene, cameras, spread, state))
    faces = facing_agreement(scene, state, targets)
    carried = _facing_released(at_video_frames(scene, state, common, targets), state, faces)
    start = carried
    if not restart:
        astray = (turned_by(state, targets) > FACING_RAD) & (faces > 0.5) & (targets.trust > 0)
        start = _replaced(replace(state, betas=carried.betas), carried, astray)
    terms = [*per_video_terms(scene, start.trans), foot_contact_term(scene, carried, state)]
    terms += deviation_terms(scene, carried, common, targets, spread, options, faces)
    solution = solve(terms, start, options.max_steps, scene.performers)
    lost = frames_lost(scene, solution.state, state)
    if lost.any():
        start = _replaced(solution.state, state, lost)
        solution = solve(terms, start, options.max_steps, scene.performers)
    return solution.state, solution.costs[-1]


def frames_lost(scene: Scene, state: MotionState, before: MotionState) -> Bool[Tensor, "B T"]:
    """Frames in which a fit turned the body away from keypoints that it explained before."""
    view = per_video_view(scene.observations, state.trans)
    after, then = (_unexplained(scene, view, motion) for motion in (state, before))
    return _smoothed(after - then, FACING_FRAMES) > LOST_SHARE


def deviation_terms(
    scene: Scene,
    start: MotionState,
    common: MotionState,
    targets: CouplingTargets,
    spread: DeviationSpread,
    options: MotionParams,
    faces: Float[Tensor, "B T"],
) -> list[Term]:
    """Coupling to the common motion, a deviation counted once per correlation time.

    Args:
        start: the common motion at every video's own frames; targets: the same in its axes.
        faces: weight of the root orientation's coupling (`facing_agreement`).
    """
    joints = joint_spread_rad(scene.body, common, spread.keypoints_m)
    joints[:, :, 0] = spread.offset_sd[:, None, 0]
    frames = correlation_frames(options, scene.fps)
    at_reference = torch.as_tensor(1 / (joints**2 * frames)).to(start.trans)
    at_reference[..., 1:] *= ROTATIONS_SHARE
    joint_weight = to_video_frames(at_reference, scene.timeline, start)
    joint_weight[..., 0] *= faces
    variance = torch.as_tensor(spread.offset_sd[:, 3:4] ** 2).to(start.trans)
    path_weight = 1 / ((variance + place_variance(scene.observations, start.trans)) * frames)
    of_positions = 1 / (pooled_spread_m(spread.beyond_modes_m) ** 2 * frames)
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


def at_video_frames(
    scene: Scene, state: MotionState, common: MotionState, targets: CouplingTargets
) -> MotionState:
    """The common motion at every video's matched frames. Unmatched ones continue it as ``state``
    moves, so that no limb jumps to the other depth that its view leaves open."""
    matched = targets.trust > 0
    betas = torch.cat([common.of_performer(p).betas for p in scene.performers])
    place = targets.root - scene.body.model.shape(betas).joints_rest[:, 0][:, None]
    edge, row = nearest_true(matched), torch.arange(len(matched), device=matched.device)[:, None]
    turn = targets.R_local[row, edge] @ state.R_local[row, edge].mT
    turn[:, :, 0] = torch.where(matched[..., None, None], turn[:, :, 0], torch.eye(3).to(turn))
    step = place[row, edge] - state.trans[row, edge]
    joined = matched.any(dim=1)[:, None, None]
    return replace(
        state,
        R_local=torch.where(joined[..., None, None], turn @ state.R_local, state.R_local),
        trans=torch.where(joined, state.trans + step, state.trans),
        betas=betas,
    )


SAME_RAD, SAME_M = 1e-3, 1e-4  # that a matched frame may differ from the common motion by


def follow_common(
    scene: Scene, state: MotionState, common: MotionState, cameras: Cameras, options: MotionParams
) -> MotionState:
    """The common motion at every video's matched frames; where a video shows more than the
    reference, its own evidence, continuing the common motion.

    Args:
        state: every video's motion so far, in its own camera's axes; common: batch of 1, world.
    """
    targets = targets_of(scene, state, common, cameras)
    start = at_video_frames(scene, state, common, targets)
    if all(np.isfinite(position).all() for position in scene.timeline.to_reference):
        return start
    matched = (targets.trust > 0).to(start.trans)
    joints = matched[..., None].expand(*matched.shape, 24) / SAME_RAD**2
    coupling = coupling_terms(scene.body, targets, start, joints, matched / SAME_M**2)
    terms = [*per_video_terms(scene, start.trans), *coupling]
    return solve(terms, start, options.max_steps, scene.performers).state

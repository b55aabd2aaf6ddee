"""From the common motion to every video's own deviation from it.

Spread of performances' per-frame rigid offsets: six standard deviations a video.

Expectation maximisation on the offsets of `terms.rigid_offset`: given the spread, every frame's
offset has a posterior; given the posteriors, the variance is their mean square. Depth, which one
view hardly observes, keeps its prior and does not contradict the image plane, because a posterior
counts with its own uncertainty.

How far each performance deviates from the common motion, estimated from the images.

What a view's reprojection errors have beyond detector noise is a difference of performance (or of
synchronisation). It is observed in the image plane; in depth the same is assumed. This moment
estimate sets the coupling's strength: strong where videos agree, weak where they do not.

Facing: does a performance face another way than the common motion, or did its fit go wrong?

A performer may face another side for a while, and then the video's root orientation must not follow
the common motion. But a monocular fit may also take the back for the front, or reverse depth, and
then the same difference of root orientations is an error that the common motion repairs. The
keypoints tell one from the other: with the common articulation, the root orientation that is right
explains them better.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from imocap_core.motion.multiview.common_keypoints import (
    CommonKeypoints,
    reprojection_errors_px,
    root_depths_m,
    views_of,
)
from imocap_core.motion.multiview.low_rank import (
    CouplingTargets,
    coupling_terms,
    position_coupling,
    to_video_axes,
    to_video_frames,
)
from imocap_core.motion.multiview.scene import (
    Cameras,
    DeviationSpread,
    Scene,
    correlation_frames,
    per_video_terms,
    root_positions,
    solve,
)
from imocap_core.motion.observations import per_video_view, place_variance
from imocap_core.motion.state import Body, MotionState
from imocap_core.motion.terms import FootContact, Reprojection, Term, View
from imocap_core.motion.terms.base import running_mean
from imocap_core.motion.terms.contact import foot_contact_share
from imocap_core.motion.terms.view import project
from imocap_core.params import MotionParams
from imocap_core.robust import geman_mcclure_weight
from imocap_core.rotations import geodesic_angle
from imocap_core.workers import at_once, in_turn

ROUNDS = 6
MIN_KEYPOINTS = 4  # fewer do not determine a rigid offset


def initial_offset_sd(videos: int, options: MotionParams) -> Float[np.ndarray, "M 6"]:
    """Generous standard deviations at which the estimation starts: rad, rad, rad, m, m, m."""
    rotation, translation = options.rigid_offset_start_rad, options.rigid_offset_start_m
    return np.tile([rotation] * 3 + [translation] * 3, (videos, 1))


def estimate_offset_sd(
    body: Body,
    motion: MotionState,
    keypoints: CommonKeypoints,
    cameras: Cameras,
    options: MotionParams,
    *,
    robust_scale: float,
) -> CommonKeypoints:
    """Keypoints with offset spreads estimated from them; a video without keypoints keeps its own.

    Args:
        motion: the common one (batch of 1, world axes).
    """
    if keypoints.offset_sd is None:
        return keypoints
    views = views_of(keypoints, cameras, motion.trans, free=())
    term = Reprojection(body, views, robust_scale)
    pairs = list(zip(views, keypoints.offset_sd, strict=True))
    each = in_turn if motion.trans.is_cuda else at_once
    spread = each(lambda pair: _offset_sd(term, pair[0], motion, pair[1], options), pairs)
    return replace(keypoints, offset_sd=np.stack(spread))


def _offset_sd(
    term: Reprojection, view: View, motion: MotionState, before: np.ndarray, options: MotionParams
) -> np.ndarray:
    usable = (view.weight > 0).sum(-1)[0] >= MIN_KEYPOINTS
    if not bool(usable.any()):
        return before
    sigma, offset = torch.as_tensor(before).to(motion.trans), None
    for _ in range(ROUNDS):
        precision = sigma.pow(-2).expand(1, len(usable), -1)
        offset, sharpness = term.rigid_offsets(view, motion, precision, offset)
        covariance = torch.linalg.inv(sharpness[0, usable])
        sigma = _mean_square(offset[0, usable], covariance, options).sqrt()
    return sigma.cpu().numpy()


def _mean_square(offset: Tensor, covariance: Tensor, options: MotionParams) -> Tensor:
    """(6,) one variance of the three rotations and one of the three translations."""
    square = offset.square() + covariance.diagonal(dim1=-2, dim2=-1)
    rotation = square[:, :3].mean().clamp_min(options.rigid_offset_floor_rad**2)
    translation = square[:, 3:].mean().clamp_min(options.rigid_offset_floor_m**2)
    return torch.cat([rotation.expand(3), translation.expand(3)])


LEAST_SPREAD_RAD, LEAST_SPREAD_M = 0.03, 0.01
LEAST_LEVER_M = 0.15
UNSEEN_SPREAD_M = 0.1  # of a video whose keypoints are missing throughout
UNMOVED_SPREAD_RAD = 0.1  # of a joint that moves no keypoint


def keypoint_spread_m(
    scene: Scene, motion: MotionState, keypoints: CommonKeypoints, cameras: Cameras
) -> Float[np.ndarray, "M N K"]:
    """Standard deviation per coordinate, metres, of each keypoint from the common motion."""
    errors = reprojection_errors_px(
        scene.body, motion, keypoints, cameras, robust_scale=scene.fit.robust_scale_sigma
    )
    depth = root_depths_m(scene.body, motion, cameras, keypoints)
    return spread_beyond_noise_m(
        errors, keypoints.sigma_px, depth, cameras.focal_px, window=round(scene.fps / 2)
    )


def with_keypoint_spread(
    body: Body,
    keypoints: CommonKeypoints,
    spread_m: Float[np.ndarray, "M N K"],
    motion: MotionState,
    cameras: Cameras,
) -> CommonKeypoints:
    """Keypoints whose variance includes the performances' deviations."""
    depth = root_depths_m(body, motion, cameras, keypoints)
    spread_px = spread_m * (cameras.focal_px[:, None] / depth)[..., None]
    sigma2 = keypoints.sigma_px[..., None] ** 2
    return replace(keypoints, weight=keypoints.weight * sigma2 / (sigma2 + spread_px**2))


def spread_beyond_noise_m(
    errors_px: Float[np.ndarray, "M N K 2"],
    sigma_px: Float[np.ndarray, "M N"],
    depth_m: Float[np.ndarray, "M N"],
    focal_px: Float[np.ndarray, " M"],
    *,
    window: int,
) -> Float[np.ndarray, "M N K"]:
    """Standard deviation per coordinate, metres, of what detector noise does not explain.

    Args:
        errors_px: NaN where missing; sigma_px: detector noise.
        window: frames over which squared errors are pooled (median, so outliers do not count).
    """
    squared = (errors_px**2).sum(-1) / 2
    half = max(1, window // 2)
    padded = np.pad(squared, ((0, 0), (half, half), (0, 0)), mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1, axis=1)
    usable = np.isfinite(windows).sum(-1) >= 3
    filled = np.where(usable[..., None], windows, 0.0)
    # the median of an exponential distribution is ln 2 times its mean
    pooled = finite_median(filled) / np.log(2)
    videos = len(errors_px)
    inflated = pooled * videos / max(videos - 1, 1)
    excess = np.maximum(inflated - sigma_px[..., None] ** 2, 0.0)
    spread = np.sqrt(excess) * (depth_m / focal_px[:, None])[..., None]
    typical = [
        np.median(s[k]) if k.any() else UNSEEN_SPREAD_M for s, k in zip(spread, usable, strict=True)
    ]
    return np.where(usable, spread, np.array(typical)[:, None, None])


def finite_median(values: Float[np.ndarray, "... W"]) -> Float[np.ndarray, "..."]:
    """Medians over the last axis without NaN (`np.nanmedian`, faster); no row may be all NaN."""
    ordered = np.sort(values, axis=-1)  # NaN last
    count = np.isfinite(values).sum(-1, keepdims=True)
    low, high = (np.take_along_axis(ordered, k, -1)[..., 0] for k in ((count - 1) // 2, count // 2))
    return np.asarray(0.5 * (low + high))


def pooled_spread_m(spread_m: Float[np.ndarray, "M N K"]) -> Float[np.ndarray, "M N K"]:
    """Spread of keypoints of which half the variance is that of all in the frame: the errors of one
    view tell little of a single keypoint's; at least LEAST_SPREAD_M."""
    variance = np.square(spread_m)
    pooled = np.sqrt((variance + variance.mean(axis=-1, keepdims=True)) / 2)
    return np.maximum(pooled, LEAST_SPREAD_M)


def joint_spread_rad(
    body: Body, motion: MotionState, spread_m: Float[np.ndarray, "M N K"]
) -> Float[np.ndarray, "M N 24"]:
    """Standard deviation of each joint's rotation: the smallest bound that a keypoint sets.

    A keypoint at distance d below joint j that deviates by s metres rotates the joint by at most
    s/d; the smallest such bound over the keypoints that the joint moves is taken.

    Args:
        motion: the common one (batch of 1).
    """
    points = body.positions(body.keypoints, motion).xyz[0]
    joints = body.positions(body.joints, motion).xyz[0]
    lever = torch.cdist(joints, points).clamp_min(LEAST_LEVER_M).cpu().numpy()  # (N, 24, K)
    moved = body.keypoints.moved_by.T.cpu().numpy()  # (24, K)
    angle = spread_m[:, :, None] / lever[None]  # (M, N, 24, K)
    angle = np.where(moved, angle, np.inf).min(-1)
    angle[:, :, ~moved.any(1)] = UNMOVED_SPREAD_RAD
    return np.maximum(angle, LEAST_SPREAD_RAD)


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
    pixels, _ = project(view, scene.body.positions(scene.body.keypoints, state).xyz)
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

"""Leave-one-out prediction: keypoints of a video from the other videos' motion.

It needs no truth. The common motion is solved again without the video, which keeps its timing; its
camera is resected from its own keypoints in every second stretch of time, and the other stretches
are predicted. Errors are shares of the person's height in the picture. What all views share, depth
above all, shows only as far as another view's motion depends on it: read it beside observability.

The yardstick beside it is the video's own monocular fit, which predicts hidden limbs.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from imocap_core.body.layouts import point_shares
from imocap_core.camera.pnp import pnp_over_frames
from imocap_core.camera.projection import project_camera
from imocap_core.motion.monocular.fit import Prediction, compared, stretches
from imocap_core.motion.multiview.common_motion import (
    CommonViews,
    estimate_terms,
    fit_common_motion,
    unknowns_of,
    with_keypoint_spread,
)
from imocap_core.motion.multiview.scene import Cameras, DeviationSpread, JointMotion, Scene
from imocap_core.motion.multiview.timeline import sample
from imocap_core.motion.observations import from_one_place
from imocap_core.motion.state import MotionState
from imocap_core.params import MotionParams

STEPS = 3  # Gauss-Newton steps from the solution with all videos
_LARGEST_PATH_SD_M = 0.04  # of performances that share one path
CAMERA_SCALE = 0.05  # Geman-McClure scale of the resection, as a share of the height


def predicted_by_others(
    scene: Scene, motion: JointMotion, options: MotionParams
) -> list[Prediction]:
    """Each video's keypoints from the motion of the other videos.

    Args:
        scene: two videos or more, with intrinsics as solved; motion: its solution.
    """
    assert motion.common is not None
    assert motion.spread is not None
    common, spread = motion.common, motion.spread
    predictions = []
    for v in range(len(scene.observations)):
        others = motion_of_others(scene, common, motion.cameras, spread, v, options)
        xyz_m = points_at_video_frames(scene, others, v)
        path_sd_m = float(spread.offset_sd[v, 3:].max())
        predictions.append(resected_prediction(scene, xyz_m, motion.cameras, v, path_sd_m))
    return predictions


def motion_of_others(
    scene: Scene,
    common: MotionState,
    cameras: Cameras,
    spread: DeviationSpread,
    v: int,
    options: MotionParams,
) -> MotionState:
    """The common motion without video ``v``; its shape and the others' cameras are free.

    Args:
        common: with all videos (batch of 1, world axes), the start.
    """
    others = without_video(scene, v)
    keypoints = replace(others.keypoints, offset_sd=spread.offset_sd)
    views = CommonViews(scene.body, keypoints, cameras, scene.fit.robust_scale_sigma)
    views = with_keypoint_spread(views, common, spread.keypoints_m)
    rest = [u for u in range(len(scene.observations)) if u != v]
    fixed = scene.reference if v != scene.reference else rest[0]  # fixes the world's axes
    terms = [*others.regularisers, *estimate_terms(others, common.trans, options)]
    unknowns = unknowns_of(scene, [u for u in rest if u != fixed])
    return fit_common_motion(views, common, unknowns, terms, STEPS)[0]


def without_video(scene: Scene, v: int) -> Scene:
    """The scene with nothing matched to video ``v``."""
    confidence = scene.timeline.confidence.copy()
    confidence[v] = 0.0
    return replace(scene, timeline=replace(scene.timeline, confidence=confidence))


def points_at_video_frames(scene: Scene, others: MotionState, v: int) -> Float[np.ndarray, "T K 3"]:
    """The keypoints' points of a motion at a video's frames, world axes, metres; NaN where no other
    video shows the moment."""
    body_state = others.of_performer(scene.observations[v].performer)
    xyz = scene.body.positions(scene.body.keypoints, body_state)[0]
    position = scene.timeline.to_reference[v]
    points = sample(xyz, position).cpu().numpy()
    shown = without_video(scene, v).timeline.confidence.max(axis=0) > 0
    nearest = np.clip(np.nan_to_num(position).round().astype(int), 0, len(shown) - 1)
    return np.where((np.isfinite(position) & shown[nearest])[:, None, None], points, np.nan)


def resected_prediction(
    scene: Scene, xyz_m: Float[np.ndarray, "T K 3"], cameras: Cameras, v: int, path_sd_m: float
) -> Prediction:
    """Errors of points in the world in every second stretch, a video's camera resected from the
    rest.

    Args:
        xyz_m: at the video's frames, NaN where unknown; cameras: where the resection starts;
            path_sd_m: deviation of the performer's path from the others'.
    """
    given = scene.observations[v]
    R, t, K = (x[v].cpu().numpy() for x in (cameras.R, cameras.t, cameras.K))
    observation, _ = from_one_place(given, xyz_m @ R.T + t)
    height_px = observation.size_px
    is_known = np.isfinite(xyz_m).all(-1) & np.isfinite(observation.xy_px).all(-1)
    shares = point_shares(scene.body.keypoints.names)
    weight = np.where(is_known, observation.confidence * shares, 0.0)
    tested = stretches(len(height_px), observation.fps) % 2 == 1
    scale_px = CAMERA_SCALE * float(np.median(height_px))
    visible = np.where(tested[:, None], 0.0, weight)
    camera = pnp_over_frames(xyz_m, observation.xy_px, visible, K, R, scale_px=scale_px)
    if not camera.ok:
        return Prediction(np.full(weight.shape, np.nan), np.zeros_like(weight))
    xy_px = project_camera(xyz_m @ camera.R.T + camera.t, K)
    is_lost = given.place_sd_m is not None and given.centre_m is None
    if is_lost or path_sd_m > _LARGEST_PATH_SD_M:
        xy_px = _in_place(xy_px, observation.xy_px, weight)
    return compared(observation, xy_px, np.where(tested[:, None], weight, 0.0))


def _in_place(
    xy_px: Float[np.ndarray, "T K 2"],
    target_px: Float[np.ndarray, "T K 2"],
    weight: Float[np.ndarray, "T K"],
) -> Float[np.ndarray, "T K 2"]:
    """Predictions moved and scaled, frame by frame, to the keypoints' weighted centre and spread,
    for cameras on unknown paths and performers who take another path than the others."""
    share = (weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-9))[..., None]
    both = np.where(share > 0, np.stack([target_px, xy_px]), 0.0)
    about = (share * both).sum(axis=2, keepdims=True)
    spread = np.sqrt((share * (both - about) ** 2).sum(axis=(2, 3), keepdims=True))
    return np.asarray(about[0] + spread[0] / np.maximum(spread[1], 1e-9) * (xy_px - about[1]))

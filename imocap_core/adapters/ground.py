"""The ground under motions: from artifacts to its estimate, and back."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import product

import numpy as np
import torch
from jaxtyping import Float

from imocap_core.artifacts.schemas import (
    Camera,
    CameraMotion,
    GroundPlane,
    Keypoints,
    SmplBa,
    SyncSummary,
    VideoCameraMotion,
    VideoKeypoints,
    VideoMotion,
)
from imocap_core.body import Model
from imocap_core.body.layouts import layout_names
from imocap_core.camera.gravity import (
    BodyMotion,
    Extrinsics,
    FilmedBody,
    estimate_ground,
    gravity_cost,
    to_world,
)
from imocap_core.camera.ground_plane import Ground
from imocap_core.camera.tilt_evidence import LevelPrior, camera_angles_deg
from imocap_core.conventions import SIDES, SMPL_JOINTS
from imocap_core.motion.hands_on_ground import hands_on_ground
from imocap_core.params import FitParams
from imocap_core.rotations import exp, log, unwrap
from imocap_core.workers import thread_map


def _level_prior(fit: FitParams) -> LevelPrior:
    """How cameras are held."""
    return LevelPrior(fit.camera_roll_deg, fit.camera_pitch_deg, fit.camera_pitch_down_deg)


def with_ground(
    motion: SmplBa,
    keypoints: Keypoints,
    camera_motion: CameraMotion,
    excluded: Collection[str],
    fit: FitParams,
) -> SmplBa:
    """A joint motion with the ground under the videos that are not `excluded`."""
    detected = {v.id: v for v in keypoints.videos}
    turns = {v.id: v.R_first_from_frame for v in camera_motion.videos}
    bodies = []
    for video, camera in zip(motion.videos, motion.cameras, strict=True):
        if video.id not in excluded:
            body = to_world(
                BodyMotion(video.theta, video.trans, video.joints), Extrinsics(camera.R, camera.t)
            )
            R_mean = turns[video.id].mean(axis=0).T @ camera.R
            bodies.append(_filmed(body.joints, detected[video.id], R_mean))
    ground = estimate_ground(bodies, _level_prior(fit))
    return motion.model_copy(update={"ground": _stored_ground(ground)})


def with_hands_on_ground(motion: SmplBa, model: Model, sync: SyncSummary) -> SmplBa:
    """A joint motion whose hands end above its ground, in the videos that stand on it."""
    if motion.ground is None:
        return motion
    ground = ground_of(motion.ground)

    def above(video: VideoMotion, camera: Camera) -> VideoMotion:
        if video.id in {*sync.excluded, *sync.mirrored}:
            return video
        R_local = exp(torch.from_numpy(video.theta.reshape(-1, 24, 3))).numpy()
        below = ground.moved(camera.R, camera.t)
        turned, joints = hands_on_ground(model, R_local, video.joints, below)
        if np.array_equal(turned, R_local):
            return video
        theta = unwrap(log(torch.from_numpy(turned))).flatten(1).numpy()
        return video.model_copy(update={"theta": theta, "joints": joints})

    pairs = zip(motion.videos, motion.cameras, strict=True)
    return motion.model_copy(update={"videos": [above(*pair) for pair in pairs]})


def grounds_of(
    videos: Sequence[VideoMotion], keypoints: Keypoints, camera_motion: CameraMotion, fit: FitParams
) -> list[GroundPlane]:
    """The ground of each video by itself, in the axes of its first-frame camera."""

    def ground(v: int) -> GroundPlane:
        R_mean = np.asarray(camera_motion.videos[v].R_first_from_frame.mean(axis=0).T)
        body = _filmed(videos[v].joints, keypoints.videos[v], R_mean)
        return _stored_ground(estimate_ground([body], _level_prior(fit)))

    return thread_map(ground, range(len(videos)))


def fall_cost(
    motion: VideoMotion, video: VideoKeypoints, camera: VideoCameraMotion, fit: FitParams
) -> float:
    """How far a monocular motion is from one that gravity allows (`gravity_cost`)."""
    R_mean = np.asarray(camera.R_first_from_frame.mean(axis=0).T)
    return gravity_cost(_filmed(motion.joints, video, R_mean), _level_prior(fit))


_BEYOND = {"ankle": ["foot"], "wrist": ["hand"], "knee": [], "elbow": []}  # that they show as well
SEEN = 0.3  # confidence: detectors give limbs that they guess less, those that they see 0.5 to 1


def _filmed(
    joints: Float[np.ndarray, "T 24 3"], video: VideoKeypoints, R: Float[np.ndarray, "3 3"]
) -> FilmedBody:
    """Arms and legs are seen where their keypoints are, the other joints always."""
    names = layout_names(video.layout)
    shown = np.ones((len(video.frames), len(SMPL_JOINTS)), dtype=bool)
    for side, limb in product(SIDES, _BEYOND):
        if (name := f"{side}_{limb}") in names:
            rows = [SMPL_JOINTS.index(f"{side}_{part}") for part in (limb, *_BEYOND[limb])]
            shown[:, rows] = video.confidence[:, [names.index(name)]] >= SEEN
    return FilmedBody(joints, video.fps, R, shown.astype(float))


def held_deg(
    up: Float[np.ndarray, "3"], camera: Camera, turned: VideoCameraMotion
) -> tuple[float, float]:
    """Roll and downward pitch of a camera, on average over its video; up: in the world's axes."""
    R_mean = turned.R_first_from_frame.mean(axis=0).T @ camera.R
    roll, down = camera_angles_deg(up[None], R_mean)
    return float(roll[0]), float(down[0])


def _stored_ground(ground: Ground) -> GroundPlane:
    """As an artifact has it."""
    return GroundPlane(
        up=ground.up,
        origin=ground.origin,
        tilt_sd_deg=ground.tilt_sd_deg,
        height_sd_mm=ground.height_sd_mm,
    )


def ground_of(plane: GroundPlane) -> Ground:
    """As the core has it."""
    return Ground(plane.up, plane.origin, plane.tilt_sd_deg, plane.height_sd_mm)

"""One video's keypoints lifted to 3D joints, as evidence and as starting points of its fit."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from imocap_core.artifacts.schemas import VideoCameraMotion, VideoKeypoints
from imocap_core.lifter.infer import Lifted, lift
from imocap_core.lifter.points import can_lift, to_common
from imocap_core.lifter.weights import load_lifter
from imocap_core.motion.kinematics import Body
from imocap_core.motion.monocular.library import Library
from imocap_core.motion.monocular.starts import Start, fit_rotations_to_joints, start_at_joints
from imocap_core.motion.observations import Observation


def starts_of(
    body: Body, library: Library, observation: Observation, lifted: Lifted
) -> list[Start]:
    """Starting points of a fit: the lifter's motion, and its alternative."""
    starts = []
    for joints in (lifted.joints, lifted.alternative):
        R_local = fit_rotations_to_joints(body, library, joints)
        starts.append(start_at_joints(body, R_local, observation))
    return starts


def evidence_of(lifted: Lifted) -> Float[np.ndarray, "T 24 3"]:
    """The lifter's joints as evidence of a fit, NaN in frames without any visible point."""
    return np.where(lifted.visible[:, None, None], lifted.joints, np.nan)


def lifted_joints(video: VideoKeypoints, camera: VideoCameraMotion) -> Lifted | None:
    """3D joints of a video's keypoints, in the axes of its first frame's camera.

    None when the layout has too few of the lifter's points, or no frame shows any.
    """
    if not can_lift(video.layout):
        return None
    present = np.isfinite(camera.xy_first_px).all(-1)
    weight = np.where(present, video.confidence, 0.0)
    focal, centre = camera.K[[0, 1], [0, 1]], camera.K[:2, 2]
    points, confidence = to_common((camera.xy_first_px - centre) / focal, weight, video.layout)
    if not (confidence > 0).any():
        return None
    return lift(load_lifter(), points, confidence, video.fps)

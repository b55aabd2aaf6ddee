"""Between artifacts and the core's lifter: one video's keypoints to 3D joints, and to starts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imocap_core.artifacts.schemas import VideoCameraMotion, VideoKeypoints
from imocap_core.lifter.infer import Lifted, lift
from imocap_core.lifter.points import can_lift, to_common
from imocap_core.lifter.weights import load_lifter
from imocap_core.motion.kinematics import Body
from imocap_core.motion.monocular.library import Library
from imocap_core.motion.monocular.starts import Start, fit_rotations_to_joints, start_at_joints
from imocap_core.motion.observations import Observation

Array = NDArray[np.float64]


def starts_of(
    body: Body, library: Library, observation: Observation, lifted: Lifted
) -> list[Start]:
    """Where a fit may begin: at the lifter's motion, and at its alternative."""
    starts = []
    for joints in (lifted.joints, lifted.alternative):
        R_local = fit_rotations_to_joints(body, library, joints)
        starts.append(start_at_joints(body, R_local, observation))
    return starts


def evidence_of(lifted: Lifted) -> Array:
    """The lifter's joints (T, 24, 3) as evidence of a fit: only where somebody is seen."""
    return np.where(lifted.seen[:, None, None], lifted.joints, np.nan)


def lifted_joints(video: VideoKeypoints, camera: VideoCameraMotion) -> Lifted | None:
    """What the lifter says of a video, in the axes of its first frame's camera.

    None when the layout has too few of the points it knows, or no frame shows any.
    """
    if not can_lift(video.layout):
        return None
    seen = np.isfinite(camera.xy_first_px).all(-1)
    trust = np.where(seen, video.confidence, 0.0)
    focal, centre = camera.K[[0, 1], [0, 1]], camera.K[:2, 2]
    points, confidence = to_common((camera.xy_first_px - centre) / focal, trust, video.layout)
    if not (confidence > 0).any():
        return None
    return lift(load_lifter(), points, confidence, video.fps)

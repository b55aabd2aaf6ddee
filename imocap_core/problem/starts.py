"""Where the monocular fits begin."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float

from imocap_core.artifacts.schemas import (
    VideoCameraMotion,
    VideoKeypoints,
)
from imocap_core.lifter.infer import Lifted, lift
from imocap_core.lifter.points import can_lift, to_common
from imocap_core.lifter.weights import load_lifter
from imocap_core.motion.kinematics import Body
from imocap_core.motion.monocular.library import Library
from imocap_core.motion.monocular.starts import (
    Start,
    fit_rotations_to_joints,
    lifted_starts,
    start_at_joints,
)
from imocap_core.motion.observations import Observation
from imocap_core.params import InitialSmplParams
from imocap_core.problem.estimates import Estimate

KEYPOINTS_ALONE = "monocular"  # origin of a fit without an estimate


def starts(
    body: Body,
    library: Library,
    observation: Observation,
    estimate: Estimate,
    lifted: Lifted | None,
    detected: Float[np.ndarray, "T 24 3"] | None,
    options: InitialSmplParams,
) -> list[Start]:
    """Starting points of one video: its estimate; or the lifter's and the detector's joints, then
    the library's poses."""
    if isinstance(estimate, Start):
        R_local, trans = (x.to(library.R_view) for x in (estimate.R_local, estimate.trans))
        return [Start(R_local, trans, estimate.cost)]
    if isinstance(estimate, torch.Tensor):
        return [start_at_joints(body, estimate.to(library.R_view), observation)]
    if estimate is not None:
        R_local = fit_rotations_to_joints(body, library, estimate)
        return [start_at_joints(body, R_local, observation)]
    joints = [] if detected is None else [detected]
    if lifted is not None:
        unseen = ~lifted.visible[:, None, None]
        joints += [np.where(unseen, np.nan, x) for x in (lifted.joints, lifted.alternative)]
    rotations = [fit_rotations_to_joints(body, library, x) for x in joints]
    of_joints = [start_at_joints(body, R_local, observation) for R_local in rotations]
    return [*of_joints, *lifted_starts(body, library, observation, options)]


def lifted_joints(
    video: VideoKeypoints, camera: VideoCameraMotion, device: torch.device | str = "cpu"
) -> Lifted | None:
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
    return lift(load_lifter(device), points, confidence, video.fps)

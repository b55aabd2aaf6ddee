"""Where the monocular fits begin, and which 3D joints are their evidence."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from jaxtyping import Float

from imocap_core.artifacts.schemas import (
    CameraMotion,
    Keypoints,
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

KEYPOINTS_ALONE = "monocular"  # origin of a start: neither an estimator nor the lifter


def starts(
    body: Body,
    library: Library,
    observation: Observation,
    estimate: Estimate,
    lifted: Lifted | None,
    options: InitialSmplParams,
) -> list[Start]:
    """Starting points of one video: its estimate, the lifter's joints, or the library's poses."""
    if lifted is not None:
        return starts_of_lifted(body, library, observation, lifted)
    if isinstance(estimate, Start):
        R_local, trans = (x.to(library.R_view) for x in (estimate.R_local, estimate.trans))
        return [Start(R_local, trans, estimate.cost)]
    if isinstance(estimate, torch.Tensor):
        return [start_at_joints(body, estimate.to(library.R_view), observation)]
    if estimate is not None:
        R_local = fit_rotations_to_joints(body, library, estimate)
        return [start_at_joints(body, R_local, observation)]
    return lifted_starts(body, library, observation, options)


def starts_of_lifted(
    body: Body, library: Library, observation: Observation, lifted: Lifted
) -> list[Start]:
    """Starting points of a fit: the lifter's motion, and its alternative."""
    motions = (lifted.joints, lifted.alternative)
    rotations = [fit_rotations_to_joints(body, library, joints) for joints in motions]
    return [start_at_joints(body, R_local, observation) for R_local in rotations]


def initial_evidence(
    estimates: Mapping[str, Estimate], lifted: Mapping[str, Lifted]
) -> dict[str, Float[np.ndarray, "_ 24 3"]]:
    """3D joints that are evidence of the monocular fits, by video."""
    joints = {video: e for video, e in estimates.items() if isinstance(e, np.ndarray)}
    return joints | {video: evidence_of(result) for video, result in lifted.items()}


def evidence_of(lifted: Lifted) -> Float[np.ndarray, "T 24 3"]:
    """The lifter's joints as evidence of a fit, NaN in frames without any visible point."""
    return np.where(lifted.visible[:, None, None], lifted.joints, np.nan)


def lifted_where_no_estimate(
    keypoints: Keypoints,
    cameras: CameraMotion,
    estimates: Mapping[str, Estimate],
    device: torch.device | str = "cpu",
) -> dict[str, Lifted]:
    """The lifter's joints of the videos without an estimate, where it can lift their keypoints."""
    pairs = zip(keypoints.videos, cameras.videos, strict=True)
    results = {v.id: lifted_joints(v, c, device) for v, c in pairs if estimates[v.id] is None}
    return {video: result for video, result in results.items() if result is not None}


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


def source_of(
    video: VideoKeypoints, estimates: Mapping[str, Estimate], lifted: Mapping[str, Lifted]
) -> str:
    """Origin of a video's start: an estimator, the lifter, or its keypoints alone."""
    if video.id in lifted:
        return "lifter"
    return KEYPOINTS_ALONE if estimates[video.id] is None else video.initial_format or ""

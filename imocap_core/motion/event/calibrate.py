"""Calibration of cameras from one event: bundle adjustment of the performer's keypoints.

All videos show the same performance, so a keypoint is one point in space that every camera sees
(Hartley and Zisserman, Multiple View Geometry, 2nd ed., section 18.1). Unknown are all points,
every camera's pose, focal length and radial distortion, and when each video began. A detector's
errors are partly constant over a view's frames, and these are larger than its noise: they are
unknowns too, with a prior, so that they are not taken for evidence of the cameras.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from imocap_core.motion.event.bones import bone_lengths, typical_lengths
from imocap_core.motion.event.normal import reduced
from imocap_core.motion.event.problem import EventProblem
from imocap_core.motion.event.reprojection import placed, project, visible
from imocap_core.motion.event.rig import CAMERA, DISTORTION, CameraRig

MOST_STEPS = 60
TOLERANCE = 1e-5  # share of the objective that the last step lowers it by
CERTAIN_SIGMAS = 3.0  # of a distortion: below, the lens counts as straight

Progress = Callable[[str], None]


@dataclass(frozen=True)
class EventCalibration:
    """A solved rig.

    Attributes:
        sd: (M, 10) standard deviations of the cameras' columns (`rig`).
        median_px: (M,) median reprojection error of each video, its biases taken off.
        cost: the objective; status: a sentence.
    """

    rig: CameraRig
    sd: Float[np.ndarray, "M C"]
    median_px: Float[np.ndarray, " M"]
    cost: float
    status: str


def calibrate(
    problem: EventProblem, start: CameraRig, progress: Progress = lambda _: None
) -> EventCalibration:
    """Solve for the rig from a start; a lens whose distortion is not certain is solved as straight.

    Args:
        start: its points, cameras and offsets; bone lengths are found from the points.
    """
    progress("calibrating the cameras from the event")
    solved, status = _descend(problem, _with_lengths(problem, start))
    sd = _column_sd(problem, solved)
    straight = np.abs(solved.distortion) < CERTAIN_SIGMAS * sd[:, DISTORTION]
    if (straight & ~problem.fixed_distortion).any():
        progress("calibrating the cameras from the event, with straight lenses")
        problem = replace(problem, fixed_distortion=problem.fixed_distortion | straight)
        again = replace(solved, distortion=np.where(straight, 0.0, solved.distortion))
        solved, status = _descend(problem, again)
        sd = _column_sd(problem, solved)
    return EventCalibration(
        solved, sd, _median_errors(problem, solved), problem.cost(solved), status
    )


def _with_lengths(problem: EventProblem, rig: CameraRig) -> CameraRig:
    visible_points = placed(problem.samples(rig))
    lengths = typical_lengths(bone_lengths(rig.points, visible_points, problem.bones))
    return replace(rig, lengths=lengths)


def _descend(problem: EventProblem, rig: CameraRig) -> tuple[CameraRig, str]:
    """Levenberg and Marquardt's damped steps."""
    damping, cost = 1e-3, problem.cost(rig)
    for step in range(MOST_STEPS):
        moved = rig.moved(*reduced(problem, rig, damping).step(damping))
        now = problem.cost(moved)
        if now < cost:
            small = cost - now < TOLERANCE * cost
            rig, cost, damping = moved, now, max(damping / 4, 1e-7)
            if small:
                return rig, f"converged after {step + 1} steps"
        else:
            damping *= 6
            if damping > 1e4:
                return rig, f"no step lowers the objective after {step + 1} steps"
    return rig, f"stopped after {MOST_STEPS} steps, before it converged"


def _column_sd(problem: EventProblem, rig: CameraRig) -> Float[np.ndarray, "M C"]:
    count = len(rig.K) * CAMERA
    variance = reduced(problem, rig).covariance().diagonal()[:count]
    return np.sqrt(np.maximum(variance, 0.0)).reshape(-1, CAMERA)


def _median_errors(problem: EventProblem, rig: CameraRig) -> Float[np.ndarray, " M"]:
    samples = problem.samples(rig)
    visible_points = visible(samples) > 0
    error = np.linalg.norm(project(rig, samples).error_px, axis=-1)
    videos = range(len(rig.K))
    return np.array(
        [
            np.median(error[..., m][visible_points[..., m]])
            if visible_points[..., m].any()
            else np.nan
            for m in videos
        ]
    )

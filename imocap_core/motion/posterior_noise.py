"""What a posterior counts as error: independent noise, model error, the covariance of joints.

The solver needs a minimum; a standard deviation needs the number of independent observations.
Detector errors and deviations of a performance persist over neighbouring frames, a pose persists
longer still, and one performer has one body. Each is counted once per its own correlation time.

Model error: what the covariance of a posterior leaves out, measured on training clips. A posterior
is conditional on its model, and neglects some dependences, as of correspondences and of errors that
persist longer than they count for. The claimed covariance is the posterior's times a factor. Where
all videos show one motion, the factor is small, and a person's joints are not exactly where those
of the body model are (tools/fit_joint_uncertainty.py). A detector's errors that last as long as a
view does are left in any case; residuals show how large they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.multiview.scene import Scene
from imocap_core.motion.state import Body, MotionState
from imocap_core.motion.terms import Term
from imocap_core.motion.terms.base import Tempered
from imocap_core.motion.terms.coupling import JointEvidence
from imocap_core.motion.terms.reprojection import Reprojection
from imocap_core.params import MotionParams, UncertaintyParams


@dataclass(frozen=True)
class Noise:
    """How long the errors behind the evidence persist."""

    params: UncertaintyParams

    def evidence_share(self, fps: float) -> float:
        """Weight of one frame's image evidence: 1 over the frames of a correlation time."""
        return 1 / max(1.0, self.params.correlation_s * fps)

    def scene(self, scene: Scene, videos: int) -> Scene:
        """The scene with the priors of a posterior; ``videos`` share one body's prior."""
        prior = 1 / max(1.0, self.params.pose_persistence_s * scene.fps)
        shape = 1 / videos  # betas are in standard deviations of the population
        fit = replace(
            scene.fit,
            pose_prior=min(prior, scene.fit.pose_prior),
            shape_prior=shape,
            hidden_shape_prior=shape,
            size_prior=shape,
        )
        return replace(scene, fit=fit)

    def options(self, options: MotionParams) -> MotionParams:
        """The options with the correlation time of the posterior."""
        return replace(options, correlation_s=self.params.correlation_s)

    def temper(self, terms: list[Term], fps: float) -> list[Term]:
        """The terms, image and estimate evidence with its share."""
        share = self.evidence_share(fps)
        evidence = (Reprojection, JointEvidence)
        return [Tempered(term, share) if isinstance(term, evidence) else term for term in terms]


PERFORMANCES_FACTOR = 1.5
# Of one motion errors are smaller than the posterior's, which allows for differing performances
ONE_MOTION_FACTOR = 0.3
PLACE_SD_M = 0.006  # of a joint in the body, along each axis
LASTING_FACTOR = 2.2  # of lasting residuals: most of an error is no residual, but fitted
SEGMENT_M = 0.4  # a limb's length
CAMERA_VARIANCE_FACTOR = 6.0


def claimed_covariance_m2(
    posterior_m2: Float[np.ndarray, "T 24 3 3"], *, one_motion: bool, lasting_m: float
) -> Float[np.ndarray, "T 24 3 3"]:
    """Covariance of the joints about the middle of the hips, the model's error included.

    Args:
        one_motion: whether all videos show one motion, and not performances that differ.
        lasting_m: root mean square of what keypoints are off all through a video, along each axis.
    """
    factor, place_m = _model_error(one_motion, lasting_m)
    return np.asarray(factor * posterior_m2 + place_m**2 * np.eye(3))


def claimed_rotations_deg2(
    posterior_rad2: Float[np.ndarray, "T K 3 3"], *, one_motion: bool, lasting_m: float
) -> Float[np.ndarray, "T K 3 3"]:
    """Covariance of the joints' rotations, the model's error included; arguments as above: a
    segment of which both ends are displaced is turned."""
    factor, place_m = _model_error(one_motion, lasting_m)
    turned_deg = np.degrees(np.sqrt(2) * place_m / SEGMENT_M)
    return np.asarray(factor * np.degrees(np.degrees(posterior_rad2)) + turned_deg**2 * np.eye(3))


def _model_error(one_motion: bool, lasting_m: float) -> tuple[float, float]:
    """The factor of the posterior, and the standard deviation of a joint's place."""
    lasting_sd_m = LASTING_FACTOR * lasting_m
    if one_motion:
        return ONE_MOTION_FACTOR, float(np.hypot(PLACE_SD_M, lasting_sd_m))
    return PERFORMANCES_FACTOR, lasting_sd_m


def claimed_rotation_sd(posterior_sd: float) -> float:
    """Standard deviation of a camera's rotation, of the same unit, the model's error included."""
    return float(np.sqrt(CAMERA_VARIANCE_FACTOR) * posterior_sd)


HIPS = [SMPL_JOINTS.index("left_hip"), SMPL_JOINTS.index("right_hip")]


@dataclass(frozen=True)
class VectorCovariance:
    """Covariance of K vectors that follow a motion's increments and its shape.

    Attributes:
        given_shape: (T, K, 3, 3) if the shape were known.
        by_shape: (T, K, 3, 10) how the vectors follow the shape.
    """

    given_shape: Float[Tensor, "T K 3 3"]
    by_shape: Float[Tensor, "T K 3 10"]

    def covariance(self, shape: Float[Tensor, "10 10"]) -> Float[Tensor, "T K 3 3"]:
        """Covariance when the shape has this covariance."""
        return self.given_shape + self.by_shape @ shape @ self.by_shape.mT


def joined(parts: Sequence[VectorCovariance]) -> VectorCovariance:
    """Parts of a motion, one after another."""
    given, by_shape = ([getattr(x, f.name) for x in parts] for f in fields(VectorCovariance))
    return VectorCovariance(torch.cat(given), torch.cat(by_shape))


def vector_covariance(
    by_frame: Float[Tensor, "T K 3 75"],
    by_shape: Float[Tensor, "T K 3 10"] | None,
    frames: Float[Tensor, "T 75 75"],
    response: Float[Tensor, "T 75 10"],
) -> VectorCovariance:
    """Covariance of vectors from that of a motion's increments.

    Args:
        by_frame, by_shape: derivatives of the vectors; None: the shape does not move them.
        frames: covariance of the increments, the shape known.
        response: with -response, frames follow the shape.
    """
    half = (by_frame.flatten(1, 2) @ frames).unflatten(1, by_frame.shape[1:3])
    follow = -torch.einsum("tkxn,tni->tkxi", by_frame, response)
    return VectorCovariance(half @ by_frame.mT, follow if by_shape is None else by_shape + follow)


def joint_jacobian(
    body: Body, motion: MotionState, frames: slice = slice(None)
) -> tuple[Float[Tensor, "T 24 3 75"], Float[Tensor, "T 24 3 10"]]:
    """Derivatives of joints about the middle of the hips by a motion's increments and its shape, of
    some frames."""
    points = body.derivatives(body.joints, motion, frames)
    d_pose, d_beta = points.d_pose[0], points.d_beta[0]
    return _about_hips(of_whole_frame(d_pose)), _about_hips(d_beta)


def of_whole_frame(by_pose: Float[Tensor, "T K 3 72"]) -> Float[Tensor, "T K 3 75"]:
    """Derivatives by a frame's increments of what its place in space does not move."""
    return torch.cat([by_pose, torch.zeros_like(by_pose[..., :3])], -1)


def _about_hips(rows: Tensor) -> Tensor:
    return rows - rows[:, HIPS].mean(1, keepdim=True)

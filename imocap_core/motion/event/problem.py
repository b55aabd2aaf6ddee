"""What a calibration from one event minimises: robust reprojection, bones, priors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from imocap_core.motion.event.bones import bone_lengths
from imocap_core.motion.event.keypoints import EventVideo, KeypointSamples, sample
from imocap_core.motion.event.reprojection import placed, project, visible
from imocap_core.motion.event.rig import (
    CAMERA,
    DISTORTION,
    FOCAL,
    OFFSET,
    RATE,
    CameraRig,
)
from imocap_core.params import EventParams
from imocap_core.robust import cauchy

ROBUST_SIGMAS = 1.0  # Cauchy scale, in standard deviations of a detection or a bone


@dataclass(frozen=True)
class EventProblem:
    """Everything that stays fixed while a rig is solved for.

    Attributes:
        videos: M of them; moments: (N,) frames of the reference that are used.
        bones: (B, 2) columns of the points.
        reference: the video whose camera is the world and whose frames are the time.
        focal_log_sd: (M,) standard deviations of the prior's focal lengths' logarithms; 0: known.
        alike: (M,) number of the kind of camera; those of one kind have similar focal lengths.
        prior: the rig that priors are about: its focal lengths, offsets, rates and bone lengths.
        offset_sd: (M,) standard deviation of its offsets, frames.
        fixed_distortion: (M,) the lenses that stay as they are in ``prior``.
    """

    videos: Sequence[EventVideo]
    moments: Float[np.ndarray, " N"]
    bones: Int[np.ndarray, "B 2"]
    reference: int
    focal_log_sd: Float[np.ndarray, " M"]
    alike: Int[np.ndarray, " M"]
    prior: CameraRig
    offset_sd: Float[np.ndarray, " M"]
    fixed_distortion: Bool[np.ndarray, " M"]
    spreads: EventParams

    def samples(self, rig: CameraRig) -> KeypointSamples:
        """The keypoints at the rig's offsets and rates."""
        return sample(self.videos, rig.offset, rig.rate, self.moments)

    @property
    def fixed(self) -> Bool[np.ndarray, "M C"]:
        """The columns of the cameras that stay as they are."""
        out = np.zeros((len(self.videos), CAMERA), dtype=bool)
        out[self.reference, [*range(6), OFFSET, RATE]] = True
        out[:, FOCAL] = self.focal_log_sd <= 0
        out[:, DISTORTION] = self.fixed_distortion
        return out

    def prior_terms(
        self, rig: CameraRig
    ) -> tuple[float, Float[np.ndarray, "M C M C"], Float[np.ndarray, "M C"]]:
        """Cost, curvature and gradient of the priors of the cameras' columns."""
        M, spread = len(self.videos), self.spreads
        away = np.zeros((M, CAMERA))
        away[:, FOCAL] = np.log(rig.focal_px / self.prior.focal_px)
        away[:, DISTORTION] = rig.distortion
        away[:, OFFSET] = rig.offset - self.prior.offset
        away[:, RATE] = np.log(rig.rate / self.prior.rate)
        precision = np.zeros((M, CAMERA))
        free = self.focal_log_sd > 0
        precision[free, FOCAL] = self.focal_log_sd[free] ** -2.0
        precision[:, DISTORTION] = spread.distortion_spread**-2
        precision[:, OFFSET] = self.offset_sd**-2.0
        precision[:, RATE] = spread.rate_spread**-2
        curvature = np.zeros((M, CAMERA, M, CAMERA))
        videos, columns = np.indices((M, CAMERA))
        curvature[videos, columns, videos, columns] = precision
        gradient = precision * away
        cost = float((precision * away**2).sum())
        same = (self.alike[:, None] == self.alike) & free[:, None] & free
        centring = np.diag(free.astype(float)) - same / np.maximum(same.sum(axis=1), 1)
        alike = centring / spread.common_focal_spread**2
        log_f = np.log(rig.focal_px)
        curvature[:, FOCAL, :, FOCAL] += alike
        gradient[:, FOCAL] += alike @ log_f
        return cost + float(log_f @ alike @ log_f), curvature, gradient

    def cost(self, rig: CameraRig) -> float:
        """The objective: minus twice the logarithm of the posterior, up to a constant."""
        samples, spread = self.samples(rig), self.spreads
        weight = visible(samples)
        squared = weight * (project(rig, samples).error_px ** 2).sum(-1)
        bones = bone_lengths(rig.points, placed(samples), self.bones)
        off = np.where(bones.present, (bones.length_m - rig.lengths) / spread.bone_noise_m, 0.0)
        biases = float((rig.bias**2).sum()) / spread.bias_share**2
        from_body = ((rig.lengths - self.prior.lengths) / spread.bone_length_spread_m) ** 2
        robust = sum(cauchy(x, ROBUST_SIGMAS)[0].sum() for x in (squared, off**2))
        return float(robust) + biases + float(from_body.sum()) + self.prior_terms(rig)[0]

"""The unknowns of a calibration from one event, and how a step changes them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

# Columns of one camera among the unknowns: rotation vector (left increment, rad), translation (m),
# logarithm of the focal length, radial distortion, offset (frames), logarithm of the rate.
ROTATION, TRANSLATION = slice(0, 3), slice(3, 6)
FOCAL, DISTORTION, OFFSET, RATE = 6, 7, 8, 9
CAMERA = 10
LARGEST_LOG_STEP = 0.3  # of a focal length, in one step


@dataclass(frozen=True)
class CameraRig:
    """M cameras, the points that they show at N moments, and what distorts their observation.

    A point's pixel is ``f (1 + k r^2) (x, y) / z + c + size * bias`` with ``(x, y, z) = R X + t``
    and ``r = |(x, y)| / z``.

    Attributes:
        K: (M, 3, 3); R: (M, 3, 3), t: (M, 3) camera from world, metres.
        distortion: (M,) the radial coefficient k.
        offset, rate: (M,) of `keypoints`.
        bias: (M, J, 2) constant errors of the detector at each point of each video, as shares of
            the person's size.
        points: (N, J, 3) metres; lengths: (B,) of the bones, metres.
    """

    K: Float[np.ndarray, "M 3 3"]
    R: Float[np.ndarray, "M 3 3"]
    t: Float[np.ndarray, "M 3"]
    distortion: Float[np.ndarray, " M"]
    offset: Float[np.ndarray, " M"]
    rate: Float[np.ndarray, " M"]
    bias: Float[np.ndarray, "M J 2"]
    points: Float[np.ndarray, "N J 3"]
    lengths: Float[np.ndarray, " B"]

    @property
    def focal_px(self) -> Float[np.ndarray, " M"]:
        """Focal lengths."""
        return self.K[:, 0, 0]

    @property
    def centre_m(self) -> Float[np.ndarray, "M 3"]:
        """Places of the cameras in the world."""
        return -np.einsum("mji,mj->mi", self.R, self.t)

    def moved(
        self, globals_: Float[np.ndarray, " P"], points: Float[np.ndarray, "N J 3"]
    ) -> CameraRig:
        """The rig after a step: all cameras' columns, then biases, then lengths; and the points."""
        videos, biases = len(self.K), self.bias.size
        camera = globals_[: CAMERA * videos].reshape(videos, CAMERA)
        growth = np.exp(np.clip(camera[:, FOCAL], -LARGEST_LOG_STEP, LARGEST_LOG_STEP))
        K = self.K.copy()
        K[:, [0, 1], [0, 1]] *= growth[:, None]
        first = CAMERA * videos
        return replace(
            self,
            K=K,
            R=Rotation.from_rotvec(camera[:, ROTATION]).as_matrix() @ self.R,
            t=self.t + camera[:, TRANSLATION],
            distortion=self.distortion + camera[:, DISTORTION],
            offset=self.offset + camera[:, OFFSET],
            rate=self.rate * np.exp(camera[:, RATE]),
            bias=self.bias + globals_[first : first + biases].reshape(self.bias.shape),
            points=self.points + points,
            lengths=self.lengths + globals_[first + biases :],
        )

    def with_lengths_of(self, lengths: Float[np.ndarray, " B"]) -> CameraRig:
        """The same pictures of a world so large that the bones have these lengths, in the median:
        pictures do not tell the size of a world, and bones that vary draw it to a smaller one."""
        factor = float(np.median(lengths / np.maximum(self.lengths, 1e-6))) if len(lengths) else 1.0
        return replace(
            self,
            t=factor * self.t,
            points=factor * self.points,
            lengths=factor * self.lengths,
        )

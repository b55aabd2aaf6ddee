"""The unknowns of a calibration from one event, its keypoints, and bones of constant length.

Keypoints of videos of one event, at the moments of the reference's frames. A frame n of the
reference shows what frame ``offset + rate * n`` of another video shows. Keypoints there are those
of a local quadratic regression, whose slope is the derivative by the offset: between two frames
interpolation would average their noise, and prefer half frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

KERNEL_FRAMES, REACH = 1.5, 4  # standard deviation of the regression's weights, and their end
RIDGE = 1e-9


@dataclass(frozen=True)
class EventVideo:
    """One video's keypoints.

    Attributes:
        xy_px: (T, J, 2), NaN where missing.
        weight: (T, J) inverse variance of a detection, 1/px^2, 0 where missing.
        size_px: (T,) the person's size.
    """

    xy_px: Float[np.ndarray, "T J 2"]
    weight: Float[np.ndarray, "T J"]
    size_px: Float[np.ndarray, " T"]


@dataclass(frozen=True)
class KeypointSamples:
    """Keypoints of M videos at N moments; 0 where a video has none.

    Attributes:
        xy_px: (N, J, M, 2); velocity_px: (N, J, M, 2) a frame of the video.
        weight: (N, J, M) 1/px^2; size_px: (N, M).
    """

    xy_px: Float[np.ndarray, "N J M 2"]
    velocity_px: Float[np.ndarray, "N J M 2"]
    weight: Float[np.ndarray, "N J M"]
    size_px: Float[np.ndarray, "N M"]

    def part(self, moments: slice) -> KeypointSamples:
        """Some of the moments."""
        values = (self.xy_px, self.velocity_px, self.weight, self.size_px)
        return KeypointSamples(*(value[moments] for value in values))


def sample(
    videos: Sequence[EventVideo],
    offset: Float[np.ndarray, " M"],
    rate: Float[np.ndarray, " M"],
    moments: Float[np.ndarray, " N"],
) -> KeypointSamples:
    """All videos at fractional frames ``offset + rate * moments``.

    A keypoint needs three frames around the moment, one of them within a frame; outside a clip
    there is none.
    """
    columns = [_one(video, offset[v] + rate[v] * moments) for v, video in enumerate(videos)]
    xy, velocity, weight, size = zip(*columns, strict=True)
    return KeypointSamples(
        np.stack(xy, 2), np.stack(velocity, 2), np.stack(weight, 2), np.stack(size, 1)
    )


def _one(
    video: EventVideo, position: Float[np.ndarray, " N"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Local quadratic regression: values (N, J, 2), velocities, weights (N, J), sizes (N,)."""
    last = len(video.xy_px) - 1
    inside = (position >= -0.5) & (position <= last + 0.5)
    centre = np.clip(position, 0, last)
    frames = np.round(centre).astype(int)[:, None] + np.arange(-REACH, REACH + 1)
    shown = (frames >= 0) & (frames <= last)
    frames = np.clip(frames, 0, last)
    away = frames - centre[:, None]
    kernel = np.where(shown, np.exp(-0.5 * (away / KERNEL_FRAMES) ** 2), 0.0)
    missing = ~np.isfinite(video.xy_px).all(-1)
    given = np.where(missing, 0.0, video.weight)[frames]  # (N, W, J)
    w = kernel[..., None] * (given > 0)
    powers = away[..., None] ** np.arange(5)
    sums = np.einsum("nwj,nwp->njp", w, powers)
    matrix = sums[..., np.add.outer(np.arange(3), np.arange(3))]
    target = np.einsum("nwj,nwp,nwjc->njpc", w, powers[..., :3], np.nan_to_num(video.xy_px)[frames])
    near = ((given > 0) & (np.abs(away) <= 1)[..., None]).any(1)
    usable = near & ((w > 0).sum(1) >= 3) & inside[:, None]
    matrix[~usable] = np.eye(3)
    solved = np.linalg.solve(matrix + RIDGE * np.eye(3), target)
    mean = np.einsum("nwj,nwj->nj", kernel[..., None] * np.ones_like(given), given)
    weight = np.where(usable, mean / np.maximum(sums[..., 0], 1e-12), 0.0)
    size = np.interp(centre, np.arange(last + 1), video.size_px)
    none = ~usable[..., None]
    return np.where(none, 0.0, solved[:, :, 0]), np.where(none, 0.0, solved[:, :, 1]), weight, size


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
            self, t=factor * self.t, points=factor * self.points, lengths=factor * self.lengths
        )


RIG_BONES = (
    ("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"),
    ("ankle", "big_toe"), ("ankle", "heel"), ("shoulder", "hip"),
)  # fmt: skip
ACROSS = (("left_hip", "right_hip"), ("left_shoulder", "right_shoulder"))
MIDDLE = (("upper_neck", "head_top"),)


@dataclass(frozen=True)
class BoneLengths:
    """Lengths of B bones at N moments.

    Attributes:
        direction: (N, B, 3) unit vector from a bone's second point to its first.
        length_m: (N, B); present: (N, B) both points are placed.
    """

    direction: Float[np.ndarray, "N B 3"]
    length_m: Float[np.ndarray, "N B"]
    present: Bool[np.ndarray, "N B"]


def bones_of(names: Sequence[str]) -> Int[np.ndarray, "B 2"]:
    """The bones between keypoints of these names, as pairs of columns."""
    column = {name: k for k, name in enumerate(names)}
    limbs = [(f"{s}_{a}", f"{s}_{b}") for s in ("left", "right") for a, b in RIG_BONES]
    pairs = [(column[a], column[b]) for a, b in (*limbs, *ACROSS, *MIDDLE) if {a, b} <= {*column}]
    return np.array(pairs, dtype=int).reshape(-1, 2)


def bone_lengths(
    points: Float[np.ndarray, "N J 3"],
    placed: Bool[np.ndarray, "N J"],
    bones: Int[np.ndarray, "B 2"],
) -> BoneLengths:
    """Lengths and directions of the bones; ``placed``: points that enough cameras see."""
    a, b = bones.T
    along = points[:, a] - points[:, b]
    length = np.linalg.norm(along, axis=-1)
    direction = along / np.maximum(length, 1e-6)[..., None]
    return BoneLengths(direction, length, placed[:, a] & placed[:, b])


def typical_lengths(bones: BoneLengths) -> Float[np.ndarray, " B"]:
    """Median length of each bone over the moments that show it; 0 where none does."""
    lengths = np.where(bones.present, bones.length_m, np.nan)
    ever = np.any(bones.present, axis=0)
    out = np.zeros(lengths.shape[1])
    out[ever] = np.nanmedian(lengths[:, ever], axis=0)
    return out

"""Keypoints of each video held against the other videos' motion, at corresponding moments.

Where the other videos' motion has a video's limbs, and which doubtful ones are elsewhere.

The video's own motion has no say in where its limbs are expected, only in where the body as a whole
is, so that an error does not confirm itself. What the detector is sure of is not asked: where
performances differ, the others contradict it, too, and it is right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from imocap_core.camera.projection import project_camera
from imocap_core.motion.multiview.common_keypoints import common_keypoints
from imocap_core.motion.multiview.scene import Cameras, Scene
from imocap_core.motion.multiview.timeline import sample
from imocap_core.motion.observations import Observation
from imocap_core.motion.state import MotionState
from imocap_core.sync.screening.registration import residual_share

MOMENTS = 60  # of the common time that are compared
SWAPPED = 0.1  # what a frame with swapped sides costs, in shares of the keypoints' spread


@dataclass(frozen=True)
class KeypointEvidence:
    """Keypoints and motions of M videos at N corresponding moments.

    Attributes:
        moments: (N,) frames of the reference.
        xyz_m: (M, N, K, 3) each video's motion in its own camera's axes.
        xy_px: (M, N, K, 2); weight: (M, N, K), 0 where unknown or unmatched.
    """

    moments: Int[np.ndarray, " N"]
    xyz_m: Float[np.ndarray, "M N K 3"]
    xy_px: Float[np.ndarray, "M N K 2"]
    weight: Float[np.ndarray, "M N K"]

    def nearest_moment(self, position: Float[np.ndarray, " T"]) -> Int[np.ndarray, " T"]:
        """Index of the moment nearest to each position in the reference, 0 where that is NaN."""
        middles = (self.moments[1:] + self.moments[:-1]) / 2.0
        return np.searchsorted(middles, np.nan_to_num(position))


def keypoint_evidence(scene: Scene, state: MotionState, moments: int = MOMENTS) -> KeypointEvidence:
    """Evenly spaced moments of the reference."""
    keypoints = common_keypoints(scene.observations, scene.timeline)
    last = keypoints.xy_px.shape[1] - 1
    frames = np.unique(np.linspace(0, last, moments).round().astype(int))
    xyz = scene.body.positions(scene.body.keypoints, state).xyz
    rows = zip(xyz, scene.observations, scene.timeline.from_reference, strict=True)
    motions = [sample(x[: len(o.xy_px)], f[frames]).cpu().numpy() for x, o, f in rows]
    scale = keypoints.sigma_px[:, frames, None] ** 2
    return KeypointEvidence(
        frames,
        np.stack(motions),
        keypoints.xy_px[:, frames],
        keypoints.weight[:, frames] * scale,
    )


def frame_residuals(
    pose: Float[np.ndarray, "N K 3"],
    xy_px: Float[np.ndarray, "N K 2"],
    weight: Float[np.ndarray, "N K"],
    R: Float[np.ndarray, "D 3 3"],
) -> Float[np.ndarray, "D N"]:
    """Share of each frame's keypoint spread that a rotated pose leaves, 0 to 1; 0 if unknown.

    Scaled orthographic: with keypoints x and a projected pose p, both about their weighted means,
    1 - <x, p>^2 / (<x, x> <p, p>) of the squared spread is left by the best positive scale.
    """
    w = weight[..., None]
    total = np.maximum(w.sum(1, keepdims=True), 1e-12)
    given = np.where(w > 0, xy_px, 0.0)
    x = given - (w * given).sum(1, keepdims=True) / total
    p = pose - (w * pose).sum(1, keepdims=True) / total
    cross = np.einsum("nk,nki,nkj->nij", weight, x, p)
    moment = np.einsum("nk,nki,nkj->nij", weight, p, p)
    product = np.einsum("dij,nij->dn", R[:, :2], cross)
    spread = np.einsum("dij,njk,dik->dn", R[:, :2], moment, R[:, :2])
    size = np.einsum("nk,nki,nki->n", weight, x, x)
    visible = (weight > 0).sum(1) > 3
    return np.where(visible, residual_share(product, spread, size), 0.0)


def registration_residuals(
    pose: Float[np.ndarray, "N K 3"],
    xy_px: Float[np.ndarray, "N K 2"],
    weight: Float[np.ndarray, "N K"],
    R: Float[np.ndarray, "D 3 3"],
    twins: Sequence[int],
) -> Float[np.ndarray, " D"]:
    """Mean residual of the visible frames for each rotation of the poses, 0 to 1.

    A frame counts with left and right swapped where that is better by `SWAPPED`.
    """
    columns = list(twins)
    plain = frame_residuals(pose, xy_px, weight, R)
    other = frame_residuals(pose, xy_px[:, columns], weight[:, columns], R)
    visible = (weight > 0).sum(1) > 3
    if not visible.any():
        return np.ones(len(R))
    return np.asarray(np.minimum(plain, other + SWAPPED)[:, visible].mean(axis=1))


def mean_of_others(
    evidence: KeypointEvidence, R: Float[np.ndarray, "M 3 3"], v: int
) -> Float[np.ndarray, "N K 3"]:
    """Mean of the other videos' poses in the world's axes, about their own centres."""
    others = [u for u in range(len(R)) if u != v]
    world = np.einsum("mji,mnkj->mnki", R[others], evidence.xyz_m[others])
    world = world - world.mean(axis=2, keepdims=True)
    matched = np.max(evidence.weight[others] > 0, axis=2)[..., None, None]
    count = np.maximum(matched.sum(axis=0), 1)
    return np.asarray((matched * world).sum(axis=0) / count)


LIMB_JOINTS = ("elbow", "wrist", "knee", "ankle")
SURE = 0.5  # confidence from which a detection is not doubted
LEAST_OTHERS = 2  # videos that show a moment: of two, either may be wrong
AWAY = 0.05  # distance, in sizes of the person, from where the others expect a joint,
SPREADS = 2.0  # and so many standard deviations of the others from one another


@dataclass(frozen=True)
class ExpectedPlaces:
    """Where the other videos expect a video's keypoints, in its first frame's picture.

    Attributes:
        xy_px: (T, K, 2), NaN in frames with too few counterparts.
        limit_px: (T, K) distance from there beyond which the others contradict a detection.
    """

    xy_px: Float[np.ndarray, "T K 2"]
    limit_px: Float[np.ndarray, "T K"]


def expected_by_others(scene: Scene, state: MotionState, cameras: Cameras) -> list[ExpectedPlaces]:
    """Of every video the places of its keypoints by the mean of the other videos' poses.

    Args:
        state: every video's motion in its own camera's axes; its body's middle is where the poses
            of the others are put.
    """
    evidence = keypoint_evidence(scene, state, scene.timeline.from_reference.shape[1])
    poses = scene.body.positions(scene.body.keypoints, state).xyz.cpu().numpy()
    R, K = cameras.R.cpu().numpy(), cameras.K.cpu().numpy()
    expected = []
    for v, o in enumerate(scene.observations):
        position = scene.timeline.to_reference[v]
        moments = evidence.nearest_moment(position)
        mean_m, sd_m, count = _mean_and_spread(evidence, R, v)
        middle = poses[v, : len(o.xy_px)].mean(axis=1, keepdims=True)
        place = np.zeros(3) if o.centre_m is None else o.centre_m[:, None]
        xy_px = project_camera(mean_m[moments] @ R[v].T + middle - place, K[v])
        sd_px = sd_m[moments] * K[v, 0, 0] / (middle - place)[..., 2]
        is_shown = np.isfinite(position) & (count[moments] >= LEAST_OTHERS)
        expected.append(
            ExpectedPlaces(
                np.where(is_shown[:, None, None], xy_px, np.nan),
                np.hypot(AWAY * o.size_px[:, None], SPREADS * sd_px),
            )
        )
    return expected


def contradicted(
    observation: Observation, expected: ExpectedPlaces, names: Sequence[str]
) -> Bool[np.ndarray, "T K"]:
    """Which limb joints were detected, with doubt, where the other videos do not have them.

    Args:
        names: of the keypoints.
    """
    away = np.linalg.norm(observation.xy_px - expected.xy_px, axis=-1)
    limbs = np.array([name.partition("_")[2] in LIMB_JOINTS for name in names])
    doubted = (observation.confidence > 0) & (observation.confidence < SURE) & limbs
    return doubted & (np.nan_to_num(away) > expected.limit_px)


def _mean_and_spread(
    evidence: KeypointEvidence, R: Float[np.ndarray, "M 3 3"], v: int
) -> tuple[
    Float[np.ndarray, "N K 3"], Float[np.ndarray, "N K"], Int[np.ndarray, " N"]
]:  # fmt: skip
    """The other videos' poses in the world's axes, each about its own middle: mean, standard
    deviation of each keypoint, and how many videos show the moment."""
    others = [u for u in range(len(R)) if u != v]
    world = np.einsum("mji,mnkj->mnki", R[others], evidence.xyz_m[others])
    world = world - world.mean(axis=2, keepdims=True)
    matched = np.max(evidence.weight[others] > 0, axis=2)[..., None]
    count = matched.sum(axis=0)
    mean = (matched[..., None] * world).sum(axis=0) / np.maximum(count, 1)[..., None]
    square = matched * np.square(world - mean).sum(axis=-1)
    return mean, np.sqrt(square.sum(axis=0) / np.maximum(count, 1)), count[:, 0]

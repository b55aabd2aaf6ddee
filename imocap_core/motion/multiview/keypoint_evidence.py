"""Keypoints of each video held against the other videos' motion, at corresponding moments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from imocap_core.motion.multiview.common_keypoints import common_keypoints
from imocap_core.motion.multiview.scene import Scene
from imocap_core.motion.multiview.timeline import sample
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

"""Pairwise agreement of hypotheses: one rotation and one warp must explain both videos' keypoints.

Under the rotation from video a to video b, a's motion is projected onto b's keypoints, and, under
its inverse, b's motion onto a's. Each direction by itself is blind to depth: reversed in a, it is
made good by a rotation the other way. Both together under one rotation are not, unless the two
videos look along one line. Keypoints are the evidence, so a wrong motion cannot vouch for another
beyond what the pictures show.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from imocap_core.sync.screening.registration import (
    Keypoints2D,
    camera_directions,
    pose_residuals,
    residual_share,
    warp_costs,
    warp_path,
)

DIRECTIONS = 96
STEPS_DEG = (8.0, 4.0, 2.0)  # of the rotation's refinement
TURNS = np.concatenate([np.eye(3), -np.eye(3)])


def pair_costs(
    motions_a: Sequence[Float[np.ndarray, "T_a J 3"]],
    motions_b: Sequence[Float[np.ndarray, "T_b J 3"]],
    keypoints_a: Keypoints2D,
    keypoints_b: Keypoints2D,
) -> Float[np.ndarray, "K_a K_b"]:
    """Mean residual of both videos' keypoints for each pair of hypotheses, 0 to 1.

    Args:
        motions_a, motions_b: the hypotheses of each video, in the axes of its own camera (y down).
    """
    forth = camera_directions(DIRECTIONS)
    R_b_from_a = np.concatenate([forth, np.cross(forth[:, :1], forth[:, 1:])], axis=1)
    back = R_b_from_a.transpose(0, 2, 1)[:, :2]
    onto_b = [pose_residuals(x, keypoints_b, forth) for x in motions_a]  # (D, T_b, T_a)
    onto_a = [pose_residuals(x, keypoints_a, back) for x in motions_b]  # (D, T_a, T_b)
    frames = np.arange(len(keypoints_b.weight))
    costs = np.zeros((len(motions_a), len(motions_b)))
    for i, j in np.ndindex(costs.shape):
        both = 0.5 * (onto_b[i] + onto_a[j].transpose(0, 2, 1))
        totals = warp_costs(both)
        best = int(totals.argmin())
        path = warp_path(both[best])
        steps = float(totals[best] - both[best][frames, path].sum())
        matched_a = Keypoints2D(keypoints_a.xy_px[path], keypoints_a.weight[path])
        sides = ((motions_a[i][path], keypoints_b), (motions_b[j], matched_a))
        costs[i, j] = refined_residual(R_b_from_a[best], *sides) + steps / len(frames)
    return costs


Side = tuple[Float[np.ndarray, "T J 3"], Keypoints2D]


def refined_residual(R_b_from_a: Float[np.ndarray, "3 3"], onto_b: Side, onto_a: Side) -> float:
    """Mean residual of two videos' matched frames at a local minimum of the rotation.

    Args:
        onto_b: a's motion and the keypoints of b; onto_a: the reverse, at the same moments.
    """

    def residuals(R: Float[np.ndarray, "D 3 3"]) -> Float[np.ndarray, " D"]:
        forth = _matched_residuals(*onto_b, R)
        return 0.5 * (forth + _matched_residuals(*onto_a, R.transpose(0, 2, 1)))

    R, residual = R_b_from_a, float(residuals(R_b_from_a[None])[0])
    for step_deg in STEPS_DEG:
        turns = Rotation.from_rotvec(TURNS * np.deg2rad(step_deg)).as_matrix()
        while True:
            near = residuals(turns @ R)
            if near.min() >= residual:
                break
            R, residual = turns[near.argmin()] @ R, float(near.min())
    return residual


def _matched_residuals(
    motion: Float[np.ndarray, "T J 3"], keypoints: Keypoints2D, R: Float[np.ndarray, "D 3 3"]
) -> Float[np.ndarray, " D"]:
    """Mean over the frames of what each rotated pose leaves of its own frame's keypoints."""
    share = keypoints.weight / np.maximum(keypoints.weight.sum(1, keepdims=True), 1e-12)
    given = np.where(keypoints.weight[..., None] > 0, keypoints.xy_px, 0.0)
    x, p = (q - np.einsum("tk,tki->ti", share, q)[:, None] for q in (given, motion))
    cross = np.einsum("tk,tki,tkj->ijt", share, x, p).reshape(6, -1)
    moment = np.einsum("tk,tki,tkj->ijt", share, p, p).reshape(9, -1)
    axes = R[:, :2]
    product = axes.reshape(-1, 6) @ cross
    spread = np.einsum("dai,daj->dij", axes, axes).reshape(-1, 9) @ moment
    size = np.einsum("tk,tki->t", share, x**2)
    return residual_share(product, spread, size).mean(axis=1)

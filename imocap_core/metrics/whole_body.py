"""Errors of the whole body: unaligned joints, joint rotations, the surface and its distortion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float, Int

from imocap_core.alignment import similarity
from imocap_core.body.kinematics import world_rotations
from imocap_core.conventions import SMPL_JOINTS, SMPL_PARENTS
from imocap_core.metrics.position import MM_PER_M, mean_joint_errors_mm
from imocap_core.workers import compiled


def aligned_joint_errors_mm(
    predicted_m: Float[np.ndarray, "T J 3"],
    true_m: Float[np.ndarray, "T J 3"],
    anchors: Sequence[int],
) -> Float[np.ndarray, " J"]:
    """Mean error of each joint after a similarity alignment of each frame on some of the joints.

    Joints that are no anchors do not influence the alignment, so their errors are not spread over
    the others as by P-MPJPE. Invariant to a similarity transform of the prediction in each frame.

    Args:
        anchors: indices of the joints that are aligned on, at least three.

    Returns:
        Millimetres; NaN for a joint that is missing throughout.
    """
    on = list(anchors)
    aligned = similarity(predicted_m[:, on], true_m[:, on]).apply(predicted_m)
    return mean_joint_errors_mm(aligned, true_m)


def vertex_distances_mm(
    predicted_m: Float[np.ndarray, "T V 3"],
    true_m: Float[np.ndarray, "T V 3"],
    predicted_root_m: Float[np.ndarray, "T 3"],
    true_root_m: Float[np.ndarray, "T 3"],
) -> Float[np.ndarray, "T V"]:
    """Distance of every vertex to its truth, the roots of both bodies at the origin, in mm.

    Their mean (`mean_over_frames`) is the per-vertex error (PVE): as MPJPE, of all vertices of the
    surface (Pavlakos et al., "Learning to estimate 3D human pose and shape from a single color
    image", CVPR 2018). Invariant to a translation of each frame.
    """
    distances = np.empty(predicted_m.shape[:2])
    for t, (predicted, true) in enumerate(zip(predicted_m, true_m, strict=True)):
        about_root = predicted.T - predicted_root_m[t][:, None]
        x, y, z = np.square(about_root - (true.T - true_root_m[t][:, None]))
        distances[t] = MM_PER_M * np.sqrt(x + y + z)
    return distances


def pa_pve_mm(predicted_m: Float[np.ndarray, "T V 3"], true_m: Float[np.ndarray, "T V 3"]) -> float:
    """Per-vertex error after a similarity Procrustes alignment of each frame (Umeyama 1991), in mm:
    P-MPJPE (`pa_mpjpe_mm`) of a surface without gaps."""
    errors = []
    for predicted, true in zip(predicted_m, true_m, strict=True):
        x, y = (points.T - points.mean(axis=0)[:, None] for points in (predicted, true))
        U, singular, Vt = np.linalg.svd(y @ x.T)
        sign = np.array([1.0, 1.0, np.linalg.det(U) * np.linalg.det(Vt)])
        scale = (singular * sign).sum() / np.vdot(x, x)
        difference = scale * (U * sign) @ Vt @ x - y
        errors.append(np.sqrt(np.einsum("cv,cv->v", difference, difference)).mean())
    return MM_PER_M * float(np.mean(errors)) if errors else float("nan")


SEGMENTS = ("pelvis", "spine3", "head", "neck", "left_collar", "right_collar")
"""The trunk's: first what turns as a whole, then bones of which only the direction counts."""
BONE_AT_REST = {
    "neck": np.array([0.0, 1.0, 0.0]),
    "left_collar": np.array([1.0, 0.0, 0.0]),
    "right_collar": np.array([-1.0, 0.0, 0.0]),
}
_FROBENIUS_AT_PI = 2.0 * np.sqrt(2.0)


def rotation_errors_deg(
    predicted: Float[np.ndarray, "*batch 3 3"], true: Float[np.ndarray, "*batch 3 3"]
) -> Float[np.ndarray, "*batch"]:
    """Geodesic distance of rotation matrices in degrees, 0 to 180.

    |A - B|_F = 2 sqrt(2) sin(angle / 2), which is accurate for small angles too (Huynh, "Metrics
    for 3D rotations", 2009). NaN where either is.
    """
    distance = np.linalg.norm(predicted - true, axis=(-1, -2))
    angle = 2 * np.arcsin(np.minimum(distance / _FROBENIUS_AT_PI, 1.0))
    return np.asarray(np.degrees(angle))


def joint_rotation_errors_deg(
    predicted: Float[np.ndarray, "T J 3 3"], true: Float[np.ndarray, "T J 3 3"]
) -> Float[np.ndarray, " J"]:
    """Mean over the frames of each joint's `rotation_errors_deg`."""
    return np.asarray(rotation_errors_deg(predicted, true).mean(axis=0))


def segment_rotations(
    R_local: Float[np.ndarray, "T 24 3 3"],
) -> dict[str, Float[np.ndarray, "T 3 3"]]:
    """SMPL joint -> rotation of its segment from rest to the root's parent axes (a camera's), for
    the `SEGMENTS` of a trunk."""
    R_world = world_rotations(torch.from_numpy(R_local), SMPL_PARENTS).numpy()
    return {name: R_world[:, SMPL_JOINTS.index(name)] for name in SEGMENTS}


def direction_errors_deg(
    predicted: Float[np.ndarray, "T 3 3"],
    true: Float[np.ndarray, "T 3 3"],
    bone: Float[np.ndarray, "3"],
) -> Float[np.ndarray, " T"]:
    """Angles in degrees between a bone turned by two rotations: turns about it do not count."""
    a, b = predicted @ bone, true @ bone
    sine = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.asarray(np.degrees(np.arctan2(sine, (a * b).sum(-1))))


def mpjae_deg(predicted: Float[np.ndarray, "T J 3 3"], true: Float[np.ndarray, "T J 3 3"]) -> float:
    """Mean per-joint angular error (MPJAE) in degrees, over joints and frames.

    As in the challenge of von Marcard et al., "Recovering accurate 3D human pose in the wild",
    ECCV 2018, but of local rotations (relative to the parent joint): an error of the hips counts
    once, not again at every joint below them.
    """
    return float(rotation_errors_deg(predicted, true).mean())


STRETCH_LIMIT = 0.4
"""Relative change of length beyond which an edge counts as stretched."""


def edges_of(faces: Int[np.ndarray, "F 3"]) -> Int[np.ndarray, "E 2"]:
    """The edges of a triangle mesh, each once, as pairs of vertex indices."""
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return np.asarray(np.unique(np.sort(directed, axis=1), axis=0))


def stretched_edge_shares(
    vertices_m: Float[np.ndarray, "T V 3"],
    rest_m: Float[np.ndarray, "V 3"],
    edges: Int[np.ndarray, "E 2"],
) -> Float[np.ndarray, " T"]:
    """Share (0 to 1) of a frame's edges longer or shorter than at rest by more than 40 %.

    A measure of this project: a pose that linear blend skinning tears or creases. Invariant to a
    rigid motion of each frame, and to a common scale of both surfaces. Edges without length at rest
    are left out.
    """
    at_rest = np.square(rest_m[edges[:, 0]] - rest_m[edges[:, 1]]).sum(axis=1)
    used = at_rest > 0
    limits = np.outer([(1 - STRETCH_LIMIT) ** 2, (1 + STRETCH_LIMIT) ** 2], at_rest[used])
    return np.asarray(_stretched(vertices_m, edges[used], limits) / used.sum())


@compiled
def _stretched(vertices, edges, limits):  # type: ignore[no-untyped-def]
    """Each frame's edges whose squared length is beyond the limits (2, E)."""
    count = np.zeros(len(vertices), np.int64)
    for t in range(len(vertices)):
        for e in range(len(edges)):
            a, b = edges[e]
            x = vertices[t, a, 0] - vertices[t, b, 0]
            y = vertices[t, a, 1] - vertices[t, b, 1]
            z = vertices[t, a, 2] - vertices[t, b, 2]
            squared = x * x + y * y + z * z
            if squared < limits[0, e] or squared > limits[1, e]:
                count[t] += 1
    return count

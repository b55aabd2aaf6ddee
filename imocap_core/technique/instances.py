"""Performances of one action at the same moments, on one body, facing one way."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

ROUNDS = 3  # of turning everyone to the mean; the first all but settles it


@dataclass(frozen=True, eq=False)
class Instances:
    """M performances at N moments; the world's y points up.

    Attributes:
        ids (M,), joint_names (J,), the pelvis first. phase_s (N,) the moments.
        R_local (M, N, J, 3, 3): against the parent; joint 0 world from body.
        joints (M, N, J, 3): metres from the pelvis, of one and the same body for all.
        inside (M, N): whether the performance shows that moment.
    """

    ids: tuple[str, ...]
    joint_names: tuple[str, ...]
    phase_s: Array
    R_local: Array
    joints: Array
    inside: NDArray[np.bool_]

    def __post_init__(self) -> None:
        """Check that the arrays belong together; ValueError names every one that does not."""
        M, N, J = len(self.ids), len(self.phase_s), len(self.joint_names)
        expected: dict[str, tuple[int, ...]] = {
            "R_local": (M, N, J, 3, 3),
            "joints": (M, N, J, 3),
            "inside": (M, N),
        }
        wrong = [
            f"{name}: expected {shape}, got {getattr(self, name).shape}"
            for name, shape in expected.items()
            if getattr(self, name).shape != shape
        ]
        if wrong:
            raise ValueError("instances: " + "; ".join(wrong))

    @property
    def shown(self) -> NDArray[np.int64]:
        """(N,) how many performances show each moment."""
        return self.inside.sum(0)


def at_moments(found: Instances, keep: NDArray[np.bool_]) -> Instances:
    """The same at some of the moments (N,)."""
    return replace(
        found,
        phase_s=found.phase_s[keep],
        R_local=found.R_local[:, keep],
        joints=found.joints[:, keep],
        inside=found.inside[:, keep],
    )


def facing_alike(found: Instances) -> Instances:
    """Everyone turned about the vertical, once for the whole performance, onto the mean.

    Where a performance faced is no technique; how it turns in its course stays.
    """
    joints, weight = found.joints, found.inside.astype(np.float64)
    headings = np.zeros(len(found.ids))
    for _ in range(ROUNDS):
        turned = np.einsum("mab,mnjb->mnja", _about_y(headings), joints)
        mean = mean_over(turned, weight)
        headings = headings + np.array(
            [heading(x, mean, w) for x, w in zip(turned, weight, strict=True)]
        )
    return turned_by(found, headings)


def to_the_front(found: Instances) -> Instances:
    """Everyone turned about the vertical by one angle, so that on the whole they face +z.

    By the pelvis's axis to the left, which stays level in a forward bend.
    """
    left = (found.inside[..., None] * found.R_local[:, :, 0, :, 0]).sum((0, 1))
    angle = float(np.arctan2(left[2], left[0]))
    return turned_by(found, np.full(len(found.ids), angle))


def turned_by(found: Instances, headings: Array) -> Instances:
    """Every performance turned about the vertical by its angle (M,), radians."""
    turns = _about_y(headings)
    R_local = found.R_local.copy()
    R_local[:, :, 0] = turns[:, None] @ found.R_local[:, :, 0]
    return replace(found, R_local=R_local, joints=np.einsum("mab,mnjb->mnja", turns, found.joints))


def heading(joints: Array, onto: Array, weight: Array) -> float:
    """The angle about y, radians, that brings joints (N, J, 3) nearest to others; weight (N,)."""
    w = weight[:, None]
    along = (w * (joints[..., 0] * onto[..., 0] + joints[..., 2] * onto[..., 2])).sum()
    aside = (w * (joints[..., 2] * onto[..., 0] - joints[..., 0] * onto[..., 2])).sum()
    return float(np.arctan2(aside, along))


def mean_over(values: Array, weight: Array) -> Array:
    """Mean over the first axis of values (M, N, ...), weighted by (M, N); 0 where all weigh 0."""
    share = weight / np.maximum(weight.sum(0), 1e-12)
    return np.einsum("mn,mn...->n...", share, values)


def _about_y(angles: Array) -> Array:
    return Rotation.from_euler("y", angles[:, None]).as_matrix().reshape(-1, 3, 3)

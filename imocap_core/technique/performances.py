"""Performances of one action at the same phases, on one body, turned to one facing direction."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

ROUNDS = 3  # alternations of mean and headings; the first nearly converges


@dataclass(frozen=True, eq=False)
class AlignedPerformances:
    """M performances at N moments; the world's y points up.

    Attributes:
        ids: names of the performances.
        joint_names: the pelvis first.
        phase_s: the moments.
        R_local: rotations against the parent; joint 0 world from body.
        joints: metres from the pelvis, of one and the same body for all.
        inside: whether the performance shows that moment.

    Raises:
        ValueError: the shapes do not belong together; names every array that does not fit.
    """

    ids: tuple[str, ...]
    joint_names: tuple[str, ...]
    phase_s: Float[np.ndarray, " N"]
    R_local: Float[np.ndarray, "M N J 3 3"]
    joints: Float[np.ndarray, "M N J 3"]
    inside: Bool[np.ndarray, "M N"]

    def __post_init__(self) -> None:
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
            raise ValueError("performances: " + "; ".join(wrong))

    @property
    def shown(self) -> Int[np.ndarray, " N"]:
        """How many performances show each moment."""
        return self.inside.sum(0)


def at_moments(
    performances: AlignedPerformances, chosen: Bool[np.ndarray, " N"]
) -> AlignedPerformances:
    """The same at the chosen moments."""
    return replace(
        performances,
        phase_s=performances.phase_s[chosen],
        R_local=performances.R_local[:, chosen],
        joints=performances.joints[:, chosen],
        inside=performances.inside[:, chosen],
    )


def facing_alike(performances: AlignedPerformances) -> AlignedPerformances:
    """Each performance turned about the vertical by one angle for all moments, onto the mean.

    The facing direction is no technique; how a performance turns in its course is preserved.
    """
    joints, weight = performances.joints, performances.inside.astype(np.float64)
    headings = np.zeros(len(performances.ids))
    for _ in range(ROUNDS):
        turned = np.einsum("mab,mnjb->mnja", _about_y(headings), joints)
        mean = mean_over(turned, weight)
        headings = headings + np.array(
            [heading(x, mean, w) for x, w in zip(turned, weight, strict=True)]
        )
    return turned_by(performances, headings)


def to_the_front(performances: AlignedPerformances) -> AlignedPerformances:
    """All performances turned about the vertical by one angle, to face +z on average.

    By the pelvis's axis to the left, which stays level in a forward bend.
    """
    left = (performances.inside[..., None] * performances.R_local[:, :, 0, :, 0]).sum((0, 1))
    angle = float(np.arctan2(left[2], left[0]))
    return turned_by(performances, np.full(len(performances.ids), angle))


def turned_by(
    performances: AlignedPerformances, headings: Float[np.ndarray, " M"]
) -> AlignedPerformances:
    """Every performance turned about the vertical by its angle, radians."""
    turns = _about_y(headings)
    R_local = performances.R_local.copy()
    R_local[:, :, 0] = turns[:, None] @ performances.R_local[:, :, 0]
    joints = np.einsum("mab,mnjb->mnja", turns, performances.joints)
    return replace(performances, R_local=R_local, joints=joints)


def heading(
    joints: Float[np.ndarray, "N J 3"],
    onto: Float[np.ndarray, "N J 3"],
    weight: Float[np.ndarray, " N"],
) -> float:
    """The angle about y, radians, that best aligns joints with others (least squares)."""
    w = weight[:, None]
    along = (w * (joints[..., 0] * onto[..., 0] + joints[..., 2] * onto[..., 2])).sum()
    aside = (w * (joints[..., 2] * onto[..., 0] - joints[..., 0] * onto[..., 2])).sum()
    return float(np.arctan2(aside, along))


def mean_over(
    values: Float[np.ndarray, "M N *rest"], weight: Float[np.ndarray, "M N"]
) -> Float[np.ndarray, "N *rest"]:
    """Weighted mean over the first axis; 0 where all weights are 0."""
    share = weight / np.maximum(weight.sum(0), 1e-12)
    return np.einsum("mn,mn...->n...", share, values)


def _about_y(angles: np.ndarray) -> np.ndarray:
    """Rotations (M, 3, 3) about the vertical by angles (M,), radians."""
    return Rotation.from_euler("y", angles[:, None]).as_matrix().reshape(-1, 3, 3)

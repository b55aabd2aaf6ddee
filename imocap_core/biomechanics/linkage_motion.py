"""The coordinates of a linkage from a motion of the body model: ISB's angles and translations."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from imocap_core.biomechanics.cardan import yxy_everywhere
from imocap_core.biomechanics.joint_angles import DECOMPOSITIONS, WORLD, YXY, joint_angles_rad
from imocap_core.biomechanics.linkage import Link
from imocap_core.biomechanics.segments import global_rotations
from imocap_core.conventions import SMPL_JOINTS

DEFINED_EVERYWHERE = DECOMPOSITIONS | {YXY: yxy_everywhere}
CARRIER = {  # of segments with translations, or with such on them: the joint that carries them
    "pelvis": "pelvis",
    "thorax": "spine3",
    "head": "head",
    "left_humerus": "left_shoulder",
    "right_humerus": "right_shoulder",
}
Series = dict[str, Float[np.ndarray, " T"]]


def to_ground(points_m: Float[np.ndarray, "*N 3"]) -> Float[np.ndarray, "*N 3"]:
    """Points of a world with y up in the ground's axes: X ahead (z), Y up, Z to the right (-x)."""
    return np.asarray(points_m @ WORLD)


def linkage_coordinates(
    links: Mapping[str, Link],
    R_local: Float[np.ndarray, "T 24 3 3"],
    joints_m: Float[np.ndarray, "T 24 3"],
    rest_m: Float[np.ndarray, "24 3"],
) -> Series:
    """Every coordinate of `linkage` over time, radians and metres, without jumps of a turn.

    Args:
        R_local, joints_m: of SMPL's joints; the first rotation and the places in a world with y up.
        rest_m: the joints of the rest pose.
    """
    values: Series = joint_angles_rad(R_local, rest_m, DEFINED_EVERYWHERE)
    frames = _frames(links, global_rotations(R_local), joints_m, rest_m)
    for link in links.values():
        if link.translations:
            values |= _translations(link, frames)
    return values


Frame = tuple[Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T 3"]]


def _frames(
    links: Mapping[str, Link],
    R: Float[np.ndarray, "T 24 3 3"],
    joints_m: Float[np.ndarray, "T 24 3"],
    rest_m: Float[np.ndarray, "24 3"],
) -> dict[str | None, Frame]:
    """Axes and origins, in the world, of the segments of the middle and of both humeri."""
    count = len(joints_m)
    frames: dict[str | None, Frame] = {None: (np.tile(WORLD, (count, 1, 1)), np.zeros((count, 3)))}
    for segment, joint in CARRIER.items():
        link, j = links[segment], SMPL_JOINTS.index(joint)
        origin = joints_m[:, j] + R[:, j] @ (link.origin_m - rest_m[j])
        frames[segment] = R[:, j] @ link.axes, origin
    return frames


def _translations(link: Link, frames: Mapping[str | None, Frame]) -> Series:
    """How far a segment's origin is from its place on the parent, in the parent's axes."""
    axes, origin = frames[link.parent]
    away = frames[link.segment][1] - origin
    moved = np.einsum("tji,tj->ti", axes, away) - link.place_m
    return dict(zip(link.translations, moved.T, strict=True))

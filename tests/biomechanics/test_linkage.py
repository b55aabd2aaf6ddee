"""The linkage: its coordinates are the joint angles, and its segments are where the body's are."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from imocap_core.biomechanics.joint_angles import WORLD, joint_angles_deg
from imocap_core.biomechanics.linkage import (
    Link,
    linkage,
    linkage_coordinates,
    segment_of_joint,
    to_ground,
)
from imocap_core.biomechanics.segments import anatomical_axes, turn_about
from imocap_core.body import load_free_body
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.result.body import posed_joints

T = 40
BODY = load_free_body()
SHAPE = 0.8 * np.random.default_rng(0).normal(size=10)
REST = posed_joints(BODY, SHAPE, np.zeros((1, 72)), np.zeros((1, 3)))[0]
LINKS = linkage(REST)


def posed(
    links: Mapping[str, Link], values: Mapping[str, Float[np.ndarray, " T"]]
) -> dict[str, tuple[Float[np.ndarray, "T 3 3"], Float[np.ndarray, "T 3"]]]:
    """Forward kinematics: every segment's axes and origin in the ground's axes.

    values: coordinates over time, radians and metres.
    """
    poses: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for name, link in links.items():
        count = len(next(iter(values.values())))
        R, origin = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
        if link.parent is not None:
            R, origin = poses[link.parent]
        moved = np.tile(link.place_m, (count, 1))
        for axis, translation in enumerate(link.translations):
            moved[:, axis] += values[translation]
        origin = origin + np.einsum("tij,tj->ti", R, moved)
        for coordinate in link.rotations:
            R = R @ turn_about(coordinate.axis, values[coordinate.name])
        poses[name] = R, origin
    return poses


def motion() -> tuple[np.ndarray, np.ndarray]:
    """Rotations and joints of a smooth random motion."""
    rng = np.random.default_rng(1)
    vectors = 2.0 * gaussian_filter1d(rng.normal(size=(T, 24, 3)), 3.0, axis=0)
    trans = rng.normal(size=(T, 3))
    joints = posed_joints(BODY, SHAPE, vectors.reshape(T, -1), trans)
    R = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().reshape(T, 24, 3, 3)
    return R, joints


def test_the_coordinates_are_the_joint_angles() -> None:
    R, joints = motion()
    values = linkage_coordinates(LINKS, R, joints, REST)
    named = {c.name for link in LINKS.values() for c in link.rotations}
    angles = joint_angles_deg(R, REST)
    assert set(angles) == named
    for name, angle in angles.items():
        away = (np.degrees(values[name]) - angle + 180) % 360 - 180
        assert np.nanmax(np.abs(away)) < 1e-6, name


def test_the_coordinates_turn_the_segments_as_the_body_is_turned() -> None:
    R, joints = motion()
    poses = posed(LINKS, linkage_coordinates(LINKS, R, joints, REST))
    for segment, axes in anatomical_axes(R, REST, "right").items():
        if segment != "hand":  # whose third angle is no coordinate
            name = segment if segment in poses else f"right_{segment}"
            np.testing.assert_allclose(poses[name][0], WORLD.T @ axes, atol=1e-9)


def test_the_segments_carry_the_joints_where_the_body_has_them() -> None:
    R, joints = motion()
    poses = posed(LINKS, linkage_coordinates(LINKS, R, joints, REST))
    seen = 0
    for j, joint in enumerate(SMPL_JOINTS):
        segment = segment_of_joint(joint)
        if segment is None:
            assert joint == "spine2"
            continue
        axes, origin = poses[segment]
        place = origin + axes @ LINKS[segment].local_m(REST[j])
        away_mm = 1000 * np.linalg.norm(place - to_ground(joints[:, j]), axis=1)
        # the hand's third angle, which is no coordinate, moves its end by little
        assert away_mm.max() < (20 if joint.endswith("hand") else 1e-3), joint
        seen += 1
    assert seen == 23


def test_at_zero_the_body_stands_with_its_arms_at_its_sides() -> None:
    names = [c.name for link in LINKS.values() for c in link.rotations]
    names += [name for link in LINKS.values() for name in link.translations]
    poses = posed(LINKS, {name: np.zeros(1) for name in names})
    for side, sign in (("left", -1), ("right", 1)):
        hand, shoulder = poses[f"{side}_hand"][1][0], poses[f"{side}_humerus"][1][0]
        thigh, foot = poses[f"{side}_thigh"][1][0], poses[f"{side}_foot"][1][0]
        assert shoulder[1] - hand[1] > 0.4
        assert np.hypot(*(shoulder - hand)[[0, 2]]) < 0.01
        assert thigh[1] - foot[1] > 0.7
        assert sign * thigh[2] > 0.05

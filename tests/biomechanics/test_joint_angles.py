"""Joint angles: signs and sides as clinicians use them, on a body in known poses; and surface
markers."""

from collections.abc import Mapping

import numpy as np
import pytest
import torch
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from imocap_core.biomechanics.joint_angles import (
    ANATOMICAL_JOINTS,
    WORLD,
    angle_names,
    angle_spreads_deg,
    definition_of,
    distal_in_proximal,
    joint_angles_deg,
    mean_curve,
    mirrored_rotation_covariance,
    rotation_jacobian,
    without_steps,
    yxy,
    yxz,
    zxy,
)
from imocap_core.biomechanics.linkage import (
    Link,
    linkage,
    linkage_coordinates,
    segment_of_joint,
    to_ground,
)
from imocap_core.biomechanics.segments import (
    MIRROR,
    anatomical_axes,
    marker_vertices,
    surface_markers,
    turn_about,
    twist_about,
)
from imocap_core.body import load_free_body
from imocap_core.conventions import SIDES, SMPL_JOINTS
from imocap_core.motion.state import TWINS
from imocap_core.result.body import posed_joints

LEFT, UP, FORWARD = np.eye(3)  # SMPL's axes
REST = posed_joints(load_free_body(), np.zeros(10), np.zeros((1, 72)), np.zeros((1, 3)))[0]


def pose(**turns: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "1 24 3 3"]:
    """The rest pose with some joints turned by axis times degrees."""
    R = np.tile(np.eye(3), (1, 24, 1, 1))
    for joint, axis_deg in turns.items():
        turn = Rotation.from_rotvec(np.radians(axis_deg)).as_matrix()
        R[0, SMPL_JOINTS.index(joint)] = turn
    return R


def angles(R: Float[np.ndarray, "1 24 3 3"]) -> dict[str, float]:
    return {name: float(values[0]) for name, values in joint_angles_deg(R, REST).items()}


AT_REST = angles(pose())


def changes(R: Float[np.ndarray, "1 24 3 3"]) -> dict[str, float]:
    """The angles that a pose changes by more than two degrees, and by how much."""
    moved = {name: value - AT_REST[name] for name, value in angles(R).items()}
    return {name: round(by, 1) for name, by in moved.items() if abs(by) > 2}


def test_the_rest_pose_is_a_t_pose_with_palms_down() -> None:
    for side in ("left", "right"):
        assert AT_REST[f"{side}_shoulder_elevation"] == pytest.approx(90, abs=2)
        assert AT_REST[f"{side}_shoulder_plane"] == pytest.approx(0, abs=2)
        assert AT_REST[f"{side}_elbow_pronation"] == pytest.approx(90, abs=2)
        assert abs(AT_REST[f"{side}_hip_flexion"]) < 2
        assert abs(AT_REST[f"{side}_knee_flexion"]) < 5
    for name in angle_names():
        if name.startswith("left_"):
            assert AT_REST[name] == pytest.approx(AT_REST["right_" + name[5:]], abs=0.01)


@pytest.mark.parametrize(
    ("joint", "axis", "angle"),
    [  # a positive turn of the right side, about an axis of SMPL's
        ("hip", -LEFT, "hip_flexion"),  # the knee goes forward
        ("hip", FORWARD, "hip_adduction"),  # and to the left
        ("hip", UP, "hip_internal_rotation"),  # toes to the left
        ("knee", LEFT, "knee_flexion"),  # the heel goes back
        ("ankle", -LEFT, "ankle_dorsiflexion"),  # toes up
        ("elbow", UP, "elbow_flexion"),  # in the T pose the forearm comes forward
        ("wrist", FORWARD, "wrist_flexion"),  # palms down: fingers go down
    ],
)
def test_a_turn_about_one_axis_is_that_angle_on_either_side(joint, axis, angle):
    right = changes(pose(**{f"right_{joint}": 40 * axis}))
    mirrored = -(MIRROR @ axis)  # an axis of rotation is a pseudovector
    left = changes(pose(**{f"left_{joint}": 40 * mirrored}))
    assert right[f"right_{angle}"] == pytest.approx(40, abs=1.5)
    assert all(name.startswith("right_") for name in right)
    assert left == {"left_" + name[6:]: by for name, by in right.items()}


def test_arms_in_front_are_the_plane_of_flexion_and_arms_at_the_sides_no_plane() -> None:
    forward = angles(pose(right_shoulder=90 * UP))
    assert forward["right_shoulder_elevation"] == pytest.approx(90, abs=2)
    assert forward["right_shoulder_plane"] == pytest.approx(90, abs=2)
    down = angles(pose(right_shoulder=90 * FORWARD))
    assert down["right_shoulder_elevation"] == pytest.approx(0, abs=3)
    assert np.isnan(down["right_shoulder_plane"])
    assert np.isnan(down["right_shoulder_internal_rotation"])


def test_bowing_is_trunk_flexion_and_leaning_the_whole_body_pelvic_tilt() -> None:
    bow = changes(pose(spine1=20 * LEFT, spine2=20 * LEFT))
    assert bow == {"trunk_flexion": pytest.approx(40, abs=0.1)}
    lean = changes(pose(pelvis=30 * LEFT))
    assert lean == {"pelvis_tilt": pytest.approx(30, abs=0.1)}
    assert changes(pose(pelvis=-20 * FORWARD)) == {"pelvis_obliquity": pytest.approx(20, abs=0.1)}
    assert changes(pose(pelvis=20 * UP)) == {"pelvis_rotation": pytest.approx(20, abs=0.1)}
    assert changes(pose(spine3=25 * UP))["trunk_left_rotation"] == pytest.approx(25, abs=0.1)
    assert changes(pose(spine3=25 * FORWARD))["trunk_right_bending"] == pytest.approx(25, abs=0.1)


@pytest.mark.parametrize("joint", ["elbow", "wrist"])
def test_a_twist_of_the_forearm_is_pronation_wherever_the_model_has_it(joint: str) -> None:
    axis = REST[SMPL_JOINTS.index("right_wrist")] - REST[SMPL_JOINTS.index("right_elbow")]
    turned = changes(pose(**{f"right_{joint}": -35 * axis / np.linalg.norm(axis)}))
    assert turned == {"right_elbow_pronation": pytest.approx(35, abs=0.2)}


def test_a_mirrored_pose_has_the_angles_of_the_other_side() -> None:
    rng = np.random.default_rng(3)
    vectors = rng.normal(size=(24, 3)) * 25
    R = pose(**dict(zip(SMPL_JOINTS, vectors, strict=True)))
    mirrored = MIRROR @ R[:, TWINS] @ MIRROR
    one, two = angles(R), angles(mirrored)
    for name, value in one.items():
        if name.startswith("left_"):
            assert two["right_" + name[5:]] == pytest.approx(value, abs=0.05)
        elif not name.startswith("right_"):
            sign = 1 if name.endswith(("flexion", "tilt")) else -1
            assert two[name] == pytest.approx(sign * value, abs=0.05)


def test_a_twist_leaves_a_rotation_that_does_not_turn_about_the_axis() -> None:
    rng = np.random.default_rng(5)
    R = Rotation.random(50, rng).as_matrix()
    axis = np.array([1.0, 2.0, -2.0]) / 3
    rest = R @ np.swapaxes(twist_about(R, axis), 1, 2)
    assert np.abs(Rotation.from_matrix(rest).as_rotvec() @ axis).max() < 1e-6


def test_angles_over_time_have_no_jumps_of_a_turn() -> None:
    steps = [pose(pelvis=angle * UP) for angle in np.arange(0, 900, 10.0)]
    turning = joint_angles_deg(np.concatenate(steps), REST)["pelvis_rotation"]
    assert np.abs(np.diff(turning) - 10).max() < 1e-6


DRAWS = 4000
POSES = (
    Rotation.from_rotvec(0.4 * np.random.default_rng(1).normal(size=(6 * 24, 3)))
    .as_matrix()
    .reshape(6, 24, 3, 3)
)
RANDOM_REST = np.random.default_rng(3).normal(size=(24, 3))


@pytest.mark.parametrize(("split", "axes"), [(zxy, "ZXY"), (yxz, "YXZ")])
def test_three_angles_give_their_rotation_back(split, axes: str) -> None:  # type: ignore[no-untyped-def]
    R = Rotation.random(200, np.random.default_rng(0)).as_matrix()
    again = Rotation.from_euler(axes, split(R)).as_matrix()
    np.testing.assert_allclose(again, R, atol=1e-9)


def test_plane_elevation_and_rotation_give_their_rotation_back() -> None:
    R = Rotation.random(200, np.random.default_rng(1)).as_matrix()
    plane, elevation, rotation = yxy(R).T
    there = np.isfinite(plane)
    assert there.mean() > 0.95
    again = Rotation.from_euler("YXY", np.stack([plane, -elevation, rotation], 1)[there])
    np.testing.assert_allclose(again.as_matrix(), R[there], atol=1e-9)


def disturbed(R_local: np.ndarray, increments: np.ndarray) -> np.ndarray:
    turns = Rotation.from_rotvec(increments.reshape(-1, 3)).as_matrix()
    return R_local @ turns.reshape(-1, 24, 3, 3)


def relative(R_local: np.ndarray) -> np.ndarray:
    """Rotations (T, 15, 3, 3) of all anatomical joints."""
    axes = {side: anatomical_axes(R_local, RANDOM_REST, side) for side in SIDES}
    of = [definition_of(joint) for joint in ANATOMICAL_JOINTS]
    return np.stack([distal_in_proximal(joint, axes[side]) for side, joint in of], axis=1)


def test_the_jacobian_is_that_of_differences() -> None:
    R = POSES[:3]
    jacobian, before = rotation_jacobian(R, RANDOM_REST), relative(R)
    for column in range(0, 72, 5):
        increments = np.zeros((1, 72))
        increments[0, column] = 1e-6
        change = np.swapaxes(before, -1, -2) @ relative(disturbed(R, increments))
        vectors = Rotation.from_matrix(change.reshape(-1, 3, 3)).as_rotvec().reshape(3, 15, 3)
        np.testing.assert_allclose(jacobian[..., column], vectors / 1e-6, atol=1e-5)


def test_standard_deviations_are_those_of_angles_of_disturbed_rotations() -> None:
    rng = np.random.default_rng(2)
    R, root = POSES[:1], 0.005 * rng.normal(size=(72, 72))
    jacobian = rotation_jacobian(R, RANDOM_REST)[0]
    covariance = np.degrees(np.degrees(jacobian @ (root @ root.T) @ np.swapaxes(jacobian, -1, -2)))
    claimed = angle_spreads_deg(R, RANDOM_REST, covariance[None], tilt_sd_deg=0.0)
    drawn = joint_angles_deg(disturbed(R, rng.normal(size=(DRAWS, 72)) @ root.T), RANDOM_REST)
    assert set(claimed) == set(angle_names())
    for name, angle in drawn.items():
        assert np.std(angle) == pytest.approx(claimed[name][0], rel=0.08), name


def test_the_pelvis_errs_by_the_world_s_tilt_and_its_camera_too() -> None:
    R = np.tile(np.eye(3), (1, 24, 1, 1))
    R[0, 0] = Rotation.from_euler("y", 30, degrees=True).as_matrix()
    none = np.zeros((1, 15, 3, 3))
    tilted = angle_spreads_deg(R, RANDOM_REST, none, tilt_sd_deg=3.0)
    assert tilted["pelvis_rotation"][0] == pytest.approx(0, abs=1e-4)
    assert tilted["pelvis_tilt"][0] == pytest.approx(3, rel=1e-3)
    assert tilted["pelvis_obliquity"][0] == pytest.approx(3, rel=1e-3)
    assert tilted["left_knee_flexion"][0] == 0
    turned = angle_spreads_deg(
        R, RANDOM_REST, none, tilt_sd_deg=np.nan, camera_sd_deg=np.sqrt(3) * 2
    )
    assert turned["pelvis_rotation"][0] == pytest.approx(2, rel=1e-3)
    assert np.isnan([turned["pelvis_tilt"][0], turned["pelvis_obliquity"][0]]).all()


def test_covariances_in_a_mirror_are_those_of_the_mirrored_pose() -> None:
    rng = np.random.default_rng(4)
    root = rng.normal(size=(72, 72))
    mirrored = (MIRROR @ POSES @ MIRROR)[:, TWINS]
    # increments of the twin, reflected: axial vectors turn the other way about the two other axes
    of_mirror = np.kron(np.eye(24)[TWINS], np.diag([1.0, -1.0, -1.0])) @ root
    rest = RANDOM_REST[TWINS] * [-1, 1, 1]
    plain, other = (
        rotation_jacobian(POSES, RANDOM_REST) @ root,
        rotation_jacobian(mirrored, rest) @ of_mirror,
    )
    expected = other @ np.swapaxes(other, -1, -2)
    found = mirrored_rotation_covariance(plain @ np.swapaxes(plain, -1, -2))
    np.testing.assert_allclose(found, expected, atol=1e-9 * expected.max())


def test_the_mean_is_over_the_performances_that_show_the_moment() -> None:
    first, second = np.array([10.0, 20.0, 30.0]), np.array([14.0, 26.0, np.nan]) + 360
    inside = [np.array([True, True, True]), np.array([False, True, True])]
    mean = mean_curve([first, second], inside)
    np.testing.assert_array_equal(mean.n, [1, 2, 1])
    np.testing.assert_allclose(mean.mean_deg, [10, 23, 30])
    np.testing.assert_allclose(mean.sd_deg, [np.nan, np.sqrt(18), np.nan])
    np.testing.assert_allclose(without_steps(mean), [10, np.nan, np.nan])


T = 40
BODY = load_free_body()
SHAPE = 0.8 * np.random.default_rng(0).normal(size=10)
SHAPED_REST = posed_joints(BODY, SHAPE, np.zeros((1, 72)), np.zeros((1, 3)))[0]
LINKS = linkage(SHAPED_REST)


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
    values = linkage_coordinates(LINKS, R, joints, SHAPED_REST)
    named = {c.name for link in LINKS.values() for c in link.rotations}
    angles = joint_angles_deg(R, SHAPED_REST)
    assert set(angles) == named
    for name, angle in angles.items():
        away = (np.degrees(values[name]) - angle + 180) % 360 - 180
        assert np.nanmax(np.abs(away)) < 1e-6, name


def test_the_coordinates_turn_the_segments_as_the_body_is_turned() -> None:
    R, joints = motion()
    poses = posed(LINKS, linkage_coordinates(LINKS, R, joints, SHAPED_REST))
    for segment, axes in anatomical_axes(R, SHAPED_REST, "right").items():
        if segment != "hand":  # whose third angle is no coordinate
            name = segment if segment in poses else f"right_{segment}"
            np.testing.assert_allclose(poses[name][0], WORLD.T @ axes, atol=1e-9)


def test_the_segments_carry_the_joints_where_the_body_has_them() -> None:
    R, joints = motion()
    poses = posed(LINKS, linkage_coordinates(LINKS, R, joints, SHAPED_REST))
    seen = 0
    for j, joint in enumerate(SMPL_JOINTS):
        segment = segment_of_joint(joint)
        if segment is None:
            assert joint == "spine2"
            continue
        axes, origin = poses[segment]
        place = origin + axes @ LINKS[segment].local_m(SHAPED_REST[j])
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


VERTICES = marker_vertices(
    BODY.v_template.numpy(), BODY.weights.numpy(), BODY.joints_template.numpy(), BODY.joint_names
)


def test_both_sides_have_the_same_markers() -> None:
    places = {name: BODY.v_template.numpy()[vertex] for name, vertex in VERTICES.items()}
    assert set(places) == set(surface_markers())
    assert len(set(VERTICES.values())) == len(VERTICES)
    for name, place in places.items():
        if name.startswith("left_"):
            mirrored = place * [-1, 1, 1]
            assert np.linalg.norm(places["right_" + name[5:]] - mirrored) < 0.005


def test_markers_move_with_their_segments() -> None:
    rng = np.random.default_rng(6)
    turns = Rotation.from_rotvec(0.4 * rng.normal(size=(24, 3))).as_matrix()
    shaped = BODY.shape(torch.as_tensor(rng.normal(size=10)))
    posed = shaped.pose(torch.as_tensor(turns[None]), torch.zeros((1, 3), dtype=torch.float64))
    R = [turns[0]]
    for joint, parent in enumerate(BODY.parents[1:], start=1):
        R.append(R[parent] @ turns[joint])
    for name, of in surface_markers().items():
        side = name.split("_")[0]
        joint = BODY.joint_names.index(
            of.joint if of.joint in BODY.joint_names else f"{side}_{of.joint}"
        )
        at_rest = shaped.vertices_rest[VERTICES[name]] - shaped.joints_rest[joint]
        now = posed.mesh().vertices[0, VERTICES[name]] - posed.joints[0, joint]
        away_m = np.linalg.norm(now.numpy() - R[joint] @ at_rest.numpy())
        assert away_m < 0.02, name

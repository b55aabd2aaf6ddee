"""Joint angles: signs and sides as clinicians use them, on a body in known poses."""

from __future__ import annotations

import numpy as np
import pytest
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from imocap_core.biomechanics.joint_angles import angle_names, joint_angles_deg
from imocap_core.biomechanics.segments import MIRROR, twist_about
from imocap_core.body import load_free_body
from imocap_core.conventions import SMPL_JOINTS as NAMES
from imocap_core.result.body import posed_joints

LEFT, UP, FORWARD = np.eye(3)  # SMPL's axes
REST = posed_joints(load_free_body(), np.zeros(10), np.zeros((1, 72)), np.zeros((1, 3)))[0]


def pose(**turns: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "1 24 3 3"]:
    """The rest pose with some joints turned by axis times degrees."""
    R = np.tile(np.eye(3), (1, 24, 1, 1))
    for joint, axis_deg in turns.items():
        turn = Rotation.from_rotvec(np.radians(axis_deg)).as_matrix()
        R[0, NAMES.index(joint)] = turn
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
def test_a_turn_about_one_axis_is_that_angle_on_either_side(
    joint: str, axis: Float[np.ndarray, " 3"], angle: str
) -> None:
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
    axis = REST[NAMES.index("right_wrist")] - REST[NAMES.index("right_elbow")]
    turned = changes(pose(**{f"right_{joint}": -35 * axis / np.linalg.norm(axis)}))
    assert turned == {"right_elbow_pronation": pytest.approx(35, abs=0.2)}


def other_side(joint: str) -> str:
    side, _, rest = joint.partition("_")
    return f"{ {'left': 'right', 'right': 'left'}[side] }_{rest}" if rest else joint


def test_a_mirrored_pose_has_the_angles_of_the_other_side() -> None:
    rng = np.random.default_rng(3)
    vectors = rng.normal(size=(24, 3)) * 25
    R = pose(**dict(zip(NAMES, vectors, strict=True)))
    sides = {"left_": "right_", "right_": "left_"}
    other = [
        next((sides[s] + j.removeprefix(s) for s in sides if j.startswith(s)), j) for j in NAMES
    ]
    mirrored = MIRROR @ R[:, [NAMES.index(j) for j in other]] @ MIRROR
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

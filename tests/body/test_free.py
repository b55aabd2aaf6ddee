"""The shipped body: a plausible adult, sound numbers, and keypoints where detectors put them."""

import numpy as np
import pytest
import torch

from imocap_core import conventions
from imocap_core.body import Model, layout_names, layouts, load_free_body
from imocap_core.body.layouts import body_layout

COUNTS = {
    "body25": 25,
    "body25b": 25,
    "coco17": 17,
    "coco18": 18,
    "halpe26": 26,
    "coco23": 23,
    "wholebody133": 133,
    "halpe136": 136,
    "h36m17": 17,
    "penn13": 13,
    "mediapipe33": 33,
    "blazepose33": 33,
    "body33": 33,
    "hands42": 42,
    "smpl24": 24,
    "smplh52": 52,
    "eval12": 12,
    "eval14": 14,
    "eval17": 17,
}


@pytest.fixture(params=[False, True], ids=["24", "52"])
def body(request: pytest.FixtureRequest) -> Model:
    return load_free_body(hands=request.param)


def at_rest(model: Model, layout: str) -> dict[str, np.ndarray]:
    """Keypoints of the mean body in the T pose, by name."""
    joints = len(model.parents)
    points = model.points(layout)
    pose = torch.eye(3, dtype=torch.float64).expand(joints, 3, 3), torch.zeros(3).double()
    placed = model.shape(torch.zeros(10).double()).pose(*pose).keypoints(points).numpy()
    return dict(zip(points.names, placed, strict=True))


def test_trees_are_smpls() -> None:
    plain, full = load_free_body(), load_free_body(hands=True)
    assert (plain.joint_names, plain.parents) == (conventions.SMPL_JOINTS, conventions.SMPL_PARENTS)
    assert (full.joint_names, full.parents) == (conventions.SMPLH_JOINTS, conventions.SMPLH_PARENTS)
    assert plain.digest != full.digest
    assert torch.equal(plain.v_template, full.v_template)


def test_numbers_are_sound(body: Model) -> None:
    ones = torch.ones(len(body.parents), dtype=torch.float64)
    torch.testing.assert_close(body.J_regressor.sum(1), ones)
    assert (body.weights >= 0).all()
    assert ((body.weights > 0).sum(1) <= 4).all()
    torch.testing.assert_close(body.weights.sum(1), torch.ones(len(body.weights)).double())
    assert body.faces.min() == 0
    assert body.faces.max() == len(body.v_template) - 1
    assert set(body.face_parts.tolist()) == set(range(len(body.part_names)))


def test_neutral_body_is_an_adult_of_1_70_m(body: Model) -> None:
    stature = np.ptp(body.v_template[:, 1].numpy())
    assert 1.66 < stature < 1.74
    joints = body.joints_template.numpy()
    np.testing.assert_allclose(joints[0], 0, atol=1e-6)
    mirrored = joints[list(conventions.mirror_indices(body.joint_names))] * [-1, 1, 1]
    np.testing.assert_allclose(joints, mirrored, atol=0.004)


def test_pelvis_stays_at_the_origin_for_every_shape(body: Model) -> None:
    betas = torch.as_tensor(np.random.default_rng(0).normal(size=(50, 10)) * 2)
    assert body.shape(betas).joints_rest[:, 0].abs().max() < 1e-4


def test_limbs_vary_independently_of_stature() -> None:
    """Ten coefficients move thigh, shin, arm, forearm and trunk in ten different ways."""
    body = load_free_body()
    chains = (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"))
    rows = []
    for b in range(10):
        joints = body.shape(2 * torch.eye(10, dtype=torch.float64)[b]).joints_rest.numpy()
        place = dict(zip(body.joint_names, joints, strict=True))
        lengths = [np.linalg.norm(place[f"left_{a}"] - place[f"left_{c}"]) for a, c in chains]
        rows.append([*lengths, np.linalg.norm(place["neck"] - place["pelvis"])])
    changes = np.array(rows) - np.mean(rows, axis=0)
    assert np.linalg.svd(changes, compute_uv=False).min() > 0.01  # metres, in every direction


@pytest.mark.parametrize("layout", COUNTS)
def test_layouts_are_complete_and_left_is_left(body: Model, layout: str) -> None:
    assert layout in layouts()
    names = layout_names(layout)
    assert len(names) == len(set(names)) == COUNTS[layout]
    points = body.points(layout)
    assert points.names == tuple(names[c] for c in points.columns)
    assert len(points.names) == COUNTS[layout] - (68 if COUNTS[layout] > 100 else 0)
    placed = np.array(list(at_rest(body, layout).values()))
    for left, right in conventions.left_right_pairs(points.names):
        assert placed[left, 0] > 0.005
        np.testing.assert_allclose(placed[left], placed[right] * [-1, 1, 1], atol=0.006)


def test_keypoints_sit_where_detectors_put_them(body: Model) -> None:
    place = at_rest(body, "body25")
    assert place["nose"][2] > place["left_eye"][2] > place["left_ear"][2]
    assert place["left_eye"][1] > place["nose"][1]
    assert 0.06 < place["left_ear"][0] < 0.1
    assert place["left_big_toe"][2] > place["left_ankle"][2] + 0.15
    assert place["left_heel"][2] < place["left_ankle"][2]
    assert place["left_big_toe"][0] < place["left_small_toe"][0]
    floor = body.v_template[:, 1].min().item()
    for name in ("left_big_toe", "left_small_toe", "left_heel"):
        assert place[name][1] < floor + 0.05
    assert 0.18 < place["left_hip"][0] - place["right_hip"][0] < 0.23
    assert (
        np.linalg.norm(place["neck"] - (place["left_shoulder"] + place["right_shoulder"]) / 2)
        < 1e-9
    )


def test_unknown_layouts_are_answered_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match="body25b"):
        load_free_body().points("body_26")


def test_nothing_falls_back_to_another_device() -> None:
    """torch's meta device has shapes but no numbers: mixing in a CPU tensor would raise."""
    model = load_free_body(device="meta", dtype=torch.float32)
    R_local = torch.empty(4, 24, 3, 3, device="meta")
    shaped = model.shape(torch.empty(10, device="meta"))
    posed = shaped.pose(R_local, torch.empty(4, 3, device="meta"))
    for result in (posed.joints, posed.mesh().vertices, posed.keypoints(model.points("body25"))):
        assert result.device.type == "meta"
        assert result.dtype == torch.float32


@pytest.mark.parametrize("layout", layouts())
def test_the_body_of_a_layout_are_its_first_points(layout: str) -> None:
    names, body = layout_names(layout), layout_names(body_layout(layout))
    assert names[: len(body)] == body
    assert not any("face" in name or "thumb" in name for name in body) or body == names


def test_mediapipe_marks_limbs_nearer_to_their_other_end(body: Model) -> None:
    marked, joints = at_rest(body, "mediapipe33"), at_rest(body, "body33")
    assert list(marked) == list(joints)
    for end, other, share in (("ankle", "knee", 0.09), ("wrist", "elbow", 0.09)):
        limb = joints[f"left_{other}"] - joints[f"left_{end}"]
        moved = marked[f"left_{end}"] - joints[f"left_{end}"]
        np.testing.assert_allclose(moved, share * limb, atol=1e-9)
    same = ("nose", "right_knee", "left_heel", "right_foot_index")
    assert all(np.array_equal(marked[name], joints[name]) for name in same)
    apart = [np.linalg.norm(p["left_hip"] - p["right_hip"]) for p in (marked, joints)]
    assert 1.1 < apart[1] / apart[0] < 1.4


def test_blazepose_marks_shoulders_nearer_to_the_neck_and_feet_higher(body: Model) -> None:
    marked, joints = at_rest(body, "blazepose33"), at_rest(body, "body33")
    assert list(marked) == list(joints)
    moved = {name: marked[name] - joints[name] for name in marked}
    neck = at_rest(body, "smpl24")["neck"]
    for side, outward in (("left", 1.0), ("right", -1.0)):
        shoulder = joints[f"{side}_shoulder"]
        np.testing.assert_allclose(moved[f"{side}_shoulder"], 0.1 * (neck - shoulder), atol=1e-9)
        assert outward * moved[f"{side}_hip"][0] < 0.0  # nearer to the joint than other detectors
        assert all(moved[f"{side}_{part}"][1] > 0.005 for part in ("ankle", "heel", "foot_index"))
    same = ("nose", "left_ear", "left_wrist", "right_index")
    assert all(np.array_equal(marked[name], joints[name]) for name in same)

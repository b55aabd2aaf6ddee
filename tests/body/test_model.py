"""Laws of the stages: agreement with the slow twin, broadcasting, and the derivatives; the shipped
body is a plausible adult."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from imocap_core import conventions
from imocap_core.body import (
    Model,
    PointSet,
    join_points,
    keypoints_with_jacobian,
    layout_names,
    layouts,
    load_free_body,
    make_points,
)
from imocap_core.body import model as convert
from imocap_core.body.layouts import body_layout, point_shares
from imocap_core.rotations import exp, right_jacobian

PARENTS = (-1, 0, 1, 2, 1, 0, 5)


def made_body(
    rng: np.random.Generator,
    vertices: int = 40,
    parents: tuple[int, ...] = PARENTS,
    shapes: int = 10,
    dtype: torch.dtype = torch.float64,
) -> Model:
    """A random but valid body: weights and regressor rows sum to 1."""
    joints = len(parents)
    weights = rng.random((vertices, joints)) ** 6
    weights /= weights.sum(1, keepdims=True)
    regressor = rng.random((joints, vertices)) ** 3
    regressor /= regressor.sum(1, keepdims=True)

    def tensor(array: np.ndarray) -> torch.Tensor:
        return torch.as_tensor(array, dtype=dtype)

    return Model(
        name="made",
        joint_names=tuple(f"j{j}" for j in range(joints)),
        parents=parents,
        v_template=tensor(rng.normal(size=(vertices, 3))),
        shapedirs=tensor(0.1 * rng.normal(size=(vertices, 3, shapes))),
        J_regressor=tensor(regressor),
        weights=tensor(weights),
        faces=torch.as_tensor(rng.integers(0, vertices, (50, 3))),
    )


def rodrigues_naive(axis_angle: np.ndarray) -> np.ndarray:
    """Matrix exponential by its power series: no formula shared with the code under test."""
    x, y, z = axis_angle
    generator = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    result, term = np.eye(3), np.eye(3)
    for n in range(1, 60):
        term = term @ generator / n
        result = result + term
    return result


def skin_naive(
    model: Model, coefficients: np.ndarray, rotations: np.ndarray, transl: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """SMPL as published, one vertex and one joint at a time: vertices (V, 3), joints (J, 3)."""
    template, shapedirs = model.v_template.double().numpy(), model.shapedirs.double().numpy()
    shaped = template + shapedirs[..., : len(coefficients)] @ coefficients
    rest = model.J_regressor.double().numpy() @ shaped
    world = []
    for j, parent in enumerate(model.parents):
        local = np.eye(4)
        local[:3, :3] = rotations[j]
        local[:3, 3] = rest[j] - (rest[parent] if parent >= 0 else 0)
        world.append(local if parent < 0 else world[parent] @ local)
    weights = model.weights.double().numpy()
    vertices = np.zeros_like(shaped)
    for v in range(len(shaped)):
        for j, transform in enumerate(world):
            vertices[v] += weights[v, j] * (
                transform[:3, :3] @ (shaped[v] - rest[j]) + transform[:3, 3]
            )
    return vertices + transl, np.stack([t[:3, 3] for t in world]) + transl


def points_of(model: Model) -> PointSet:
    """A joint, a vertex, a mix of joints, and a mix of both."""
    return make_points(
        model,
        ("joint", "vertex", "joints", "mix"),
        ({3: 1.0}, {}, {2: 0.3, 6: 0.7}, {0: 0.5}),
        ({}, {7: 1.0}, {}, {1: 0.2, 9: 0.3}),
    )


def pose_of(
    rng: np.random.Generator, *leading: int, joints: int = 7
) -> tuple[torch.Tensor, torch.Tensor]:
    return torch.as_tensor(rng.normal(size=(*leading, joints, 3))), torch.as_tensor(
        rng.normal(size=(*leading, 3))
    )


@pytest.mark.parametrize(("dtype", "bound_m"), [(torch.float64, 1e-10), (torch.float32, 1e-5)])
def test_agrees_with_the_published_formulas(dtype, bound_m):
    rng = np.random.default_rng(0)
    model = made_body(rng, dtype=dtype)
    theta, transl = pose_of(rng)
    betas = rng.normal(size=10)
    rotations = np.stack([rodrigues_naive(a) for a in theta.numpy()])
    vertices, joints = skin_naive(model, betas, rotations, transl.numpy())
    posed = model.shape(torch.as_tensor(betas, dtype=dtype)).pose(
        exp(theta.to(dtype)), transl.to(dtype)
    )
    assert np.abs(posed.mesh().vertices.numpy() - vertices).max() < bound_m
    assert np.abs(posed.joints.numpy() - joints).max() < bound_m
    mixed = 0.5 * joints[0] + 0.2 * vertices[1] + 0.3 * vertices[9]
    expected = np.stack([joints[3], vertices[7], 0.3 * joints[2] + 0.7 * joints[6], mixed])
    assert np.abs(posed.keypoints(points_of(model)).numpy() - expected).max() < bound_m


@pytest.mark.parametrize("betas_leading", [(), (1,), (2, 1), (1, 5), (2, 5)])
def test_leading_axes_broadcast(betas_leading: tuple[int, ...]) -> None:
    rng = np.random.default_rng(1)
    model = made_body(rng)
    points = points_of(model)
    theta, transl = pose_of(rng, 2, 5)
    betas = torch.as_tensor(rng.normal(size=(*betas_leading, 10)))
    shaped = model.shape(betas)
    xyz, d_pose, d_shape = keypoints_with_jacobian(shaped, points, exp(theta), transl)
    posed = shaped.pose(exp(theta), transl)
    every = betas.expand(2, 5, 10)
    for v in range(2):
        for t in range(5):
            alone = model.shape(every[v, t])
            single = keypoints_with_jacobian(alone, points, exp(theta[v, t]), transl[v, t])
            for many, one in zip((xyz, d_pose, d_shape), single, strict=True):
                torch.testing.assert_close(many[v, t], one)
            pose = alone.pose(exp(theta[v, t]), transl[v, t])
            torch.testing.assert_close(posed.joints[v, t], pose.joints)
            torch.testing.assert_close(posed.mesh().vertices[v, t], pose.mesh().vertices)
            torch.testing.assert_close(posed.keypoints(points)[v, t], single[0])


def test_derivatives_equal_automatic_ones_in_axis_angle() -> None:
    rng = np.random.default_rng(3)
    model = made_body(rng)
    points = points_of(model)
    theta, transl = pose_of(rng)
    betas = torch.as_tensor(rng.normal(size=10))
    _, d_pose, d_shape = keypoints_with_jacobian(model.shape(betas), points, exp(theta), transl)

    def place(theta: torch.Tensor, betas: torch.Tensor) -> torch.Tensor:
        return model.shape(betas).pose(exp(theta), transl).keypoints(points)

    by_theta, by_betas = torch.autograd.functional.jacobian(place, (theta, betas))
    d_theta = torch.einsum("kcji,jia->kcja", d_pose.unflatten(-1, (7, 3)), right_jacobian(theta))
    torch.testing.assert_close(d_theta, by_theta, atol=1e-12, rtol=1e-12)
    torch.testing.assert_close(d_shape, by_betas, atol=1e-12, rtol=1e-12)


def test_joined_sets_of_points_answer_like_each_alone() -> None:
    rng = np.random.default_rng(6)
    model = made_body(rng)
    joints_only = make_points(model, ("a", "b"), ({1: 1.0}, {4: 1.0}), ({}, {}))
    sets = [points_of(model), joints_only, points_of(model)]
    theta, transl = pose_of(rng, 3)
    shaped = model.shape(torch.as_tensor(rng.normal(size=10)))
    whole = keypoints_with_jacobian(shaped, join_points(sets), exp(theta), transl)
    parts = [keypoints_with_jacobian(shaped, points, exp(theta), transl) for points in sets]
    for i, result in enumerate(whole):
        torch.testing.assert_close(result, torch.cat([part[i] for part in parts], dim=1))
    assert join_points(sets[:1]) is sets[0]


def test_a_point_that_would_not_move_with_the_body_is_refused() -> None:
    model = made_body(np.random.default_rng(4))
    with pytest.raises(ValueError, match="sum to 1"):
        make_points(model, ("half",), ({0: 0.5},), ({},))


def test_misuse_says_what_was_expected() -> None:
    model = made_body(np.random.default_rng(5))
    with pytest.raises(ValueError, match="at most 10"):
        model.shape(torch.zeros(11, dtype=torch.float64))
    with pytest.raises(ValueError, match=r"expected \(\.\.\., 7, 3, 3\)"):
        model.shape(torch.zeros(10, dtype=torch.float64)).pose(torch.eye(3), torch.zeros(3))


def rotations(*leading: int) -> torch.Tensor:
    rng = np.random.default_rng(0)
    matrices = Rotation.random(int(np.prod(leading)), rng=rng).as_matrix()
    return torch.as_tensor(matrices.reshape(*leading, 3, 3))


def test_axis_angle_poses_round_trip() -> None:
    R_local = rotations(4, 24)
    theta = convert.pose_from_rotations(R_local)
    torch.testing.assert_close(convert.rotations_from_pose(theta), R_local)
    with pytest.raises(ValueError, match="3 J"):
        convert.rotations_from_pose(torch.zeros(2, 71))


def test_body_joints_stay_when_fingers_are_added() -> None:
    """The 24-joint and the 52-joint free body agree on everything up to the wrists."""
    R_local = rotations(3, 24)
    shape = torch.as_tensor(np.random.default_rng(2).normal(size=10))
    transl = torch.zeros(3, 3, dtype=torch.float64)
    plain = load_free_body().shape(shape).pose(R_local, transl)
    full = load_free_body(hands=True).shape(shape).pose(convert.smplh_from_smpl(R_local), transl)
    torch.testing.assert_close(full.joints[:, :22], plain.joints[:, :22])


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


def test_many_points_on_a_head_say_no_more_than_one() -> None:
    names = ("nose", "left_eye", "left_ear", "left_knee", "left_foot_index", "left_wrist")
    assert point_shares(names).tolist() == [1 / 3, 1 / 3, 1 / 3, 1, 1, 1]
    hands = ("left_thumb", "left_index", "right_thumb", "right_index", "left_hip")
    assert point_shares(hands).tolist() == [0.5] * 4 + [1]
    assert point_shares(("nose", "left_thumb", "left_hip")).tolist() == [1] * 3

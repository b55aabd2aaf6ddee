"""What the network reads does not depend on where in the picture the person is; a video goes
through it frame by frame."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from imocap_core.body import load_free_body
from imocap_core.body.layouts import layout_keypoints
from imocap_core.conventions import SMPL_JOINTS, mirror_indices
from imocap_core.lifter.infer import lift, stitch_alternatives, window_rows
from imocap_core.lifter.lifter_network import (
    COMMON,
    FEATURES,
    MIRROR,
    WINDOW,
    Lifter,
    can_lift,
    columns_of,
    load_lifter,
    person_centred_features,
    read_weights,
    to_common,
    write_weights,
)

K = len(COMMON)


def person(seed: int = 0) -> torch.Tensor:
    """Points (1, L, K, 3) about a person 4 m in front of the camera."""
    rng = np.random.default_rng(seed)
    return torch.as_tensor(rng.normal(0, 0.4, (1, 5, K, 3)) + (0.2, -0.1, 4.0))


def rays_of(points: torch.Tensor) -> torch.Tensor:
    return points[..., :2] / points[..., 2:]


@pytest.mark.parametrize("angle", [-0.5, 0.2, 0.7])
def test_panning_the_camera_changes_nothing_but_its_own_turn(angle: float) -> None:
    """The features stay to rounding of the middle: exactly where the median ray is the same."""
    pan = torch.tensor(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    )
    points = person()
    trust = torch.ones(points.shape[:3], dtype=points.dtype)
    still, panned = (person_centred_features(rays_of(x), trust) for x in (points, points @ pan.T))
    turned_back = panned.R_turned_from_cam @ pan
    away = torch.acos(
        ((turned_back @ still.R_turned_from_cam.mT).diagonal(dim1=1, dim2=2).sum(-1) - 1) / 2
    )
    assert float(away) < 0.05  # a median per axis is not quite the same point after a turn
    assert float((panned.features - still.features).abs().mean()) < 0.05


def test_the_camera_turns_to_the_person() -> None:
    points = person()
    trust = torch.ones(points.shape[:3], dtype=points.dtype)
    centred = person_centred_features(rays_of(points), trust)
    middle = torch.cat([rays_of(points).flatten(1, 2).median(1).values, torch.ones(1, 1)], -1)
    turned = centred.R_turned_from_cam[0] @ middle[0].double()
    np.testing.assert_allclose(turned[:2], 0, atol=1e-9)
    R = centred.R_turned_from_cam[0]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-9)
    assert float(torch.linalg.det(R)) == pytest.approx(1.0)


def test_a_nearer_person_differs_in_one_feature_alone() -> None:
    """Rays that are all larger by a factor say nearer, and nothing else of the pose."""
    rng = np.random.default_rng(1)
    rays = torch.as_tensor(rng.normal(0, 0.02, (1, 5, K, 2)))
    rays = rays - rays.flatten(1, 2).median(1).values
    trust = torch.ones(rays.shape[:3], dtype=rays.dtype)
    far, near = (person_centred_features(s * rays, trust).features for s in (1.0, 2.0))
    change = (near - far).abs().amax((0, 1))
    nearness = FEATURES - 2
    assert float(change[nearness]) == pytest.approx(np.log(2), abs=1e-6)
    assert float(torch.cat([change[:nearness], change[nearness + 1 :]]).max()) < 1e-6


def test_what_is_not_seen_does_not_matter() -> None:
    points = person()
    trust = torch.ones(points.shape[:3], dtype=points.dtype)
    trust[:, 2, 4:9] = 0.0
    trust[:, 4] = 0.0
    rays = rays_of(points)
    junk = torch.where(trust[..., None] > 0, rays, 77.0)
    a, b = person_centred_features(rays, trust), person_centred_features(junk, trust)
    np.testing.assert_array_equal(a.features, b.features)
    assert (a.features[:, 4] == 0).all()


LAYOUTS = (
    "body25",
    "body25b",
    "coco17",
    "coco18",
    "halpe26",
    "h36m17",
    "mediapipe33",
    "blazepose33",
)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_column_goes_to_the_point_it_sits_at(layout: str) -> None:
    columns, rows = columns_of(layout)
    keypoints = layout_keypoints(layout)
    points = [re.sub("_(mediapipe|blazepose)$", "", keypoints[c].point) for c in columns]
    assert points == [COMMON[r] for r in rows]
    assert len(rows) >= 15


def test_two_detectors_of_one_body_say_the_same() -> None:
    """What BODY_25 and Halpe-26 see of a body lands at the same places."""
    model = load_free_body()
    posed = model.shape(model.v_template.new_zeros(1, 10))
    eye = torch.eye(3, dtype=torch.float64).expand(1, 24, 3, 3)
    body = posed.pose(eye, model.v_template.new_zeros(1, 3))
    common = {}
    for layout in ("body25", "halpe26"):
        xy = body.keypoints(model.points(layout))[..., :2].numpy()
        common[layout] = to_common(xy, np.ones(xy.shape[:2]), layout)
    (a, trust_a), (b, trust_b) = common["body25"], common["halpe26"]
    both = (trust_a > 0) & (trust_b > 0)
    assert both.sum() >= 22
    np.testing.assert_allclose(a[both], b[both], atol=1e-12)


def test_missing_points_are_zero_without_confidence() -> None:
    xy = np.full((2, 17, 2), np.nan)
    xy[:, 5] = 3.0
    points, trust = to_common(xy, np.full((2, 17), 2.0), "coco17")
    assert np.isfinite(points).all()
    assert trust.sum() == 2.0  # one point a frame, cut off at 1
    assert (points[trust > 0] == 3.0).all()


def test_mirroring_twice_changes_nothing() -> None:
    assert [MIRROR[i] for i in MIRROR] == list(range(len(COMMON)))


def test_hands_alone_are_too_little() -> None:
    assert not can_lift("left_hand21")
    assert can_lift("coco17")
    with pytest.raises(ValueError, match="left_hand21"):
        columns_of("left_hand21")


@pytest.fixture(scope="module")
def content(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = Path(tmp_path_factory.mktemp("weights") / "some.safetensors")
    write_weights(path, load_lifter())
    return path.read_bytes()


def test_read_as_written(content: bytes) -> None:
    weights, original = (n.state_dict() for n in (read_weights(content, "x"), load_lifter()))
    assert weights.keys() == original.keys() == Lifter().state_dict().keys()
    for name, weight in original.items():
        assert weights[name].dtype == torch.float32
        torch.testing.assert_close(weights[name], weight, rtol=0, atol=0)


@pytest.mark.parametrize(
    "damage",
    [
        lambda d: d[:4],
        lambda d: d[:8] + b"}" + d[9:],
        lambda d: d[:-3],
        lambda d: d.replace(b"F16", b"F64"),
        lambda d: d.replace(b"first.bias", b"final.bias"),
        lambda d: d.replace(b"[256]", b"[255]"),
    ],
)
def test_damage_is_named(damage: Callable[[bytes], bytes], content: bytes) -> None:
    with pytest.raises(ValueError, match=r"some\.safetensors: expected the lifter's weights, got"):
        read_weights(damage(content), "some.safetensors")


@pytest.fixture(scope="module")
def network() -> Lifter:
    """Untrained: laws of the way round it hold for any weights."""
    torch.manual_seed(0)
    return Lifter(width=16, blocks=1).eval().requires_grad_(False)


def walk(frames: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    pose = rng.normal(0, 0.1, (1, K, 2))
    path = np.cumsum(rng.normal(0, 0.002, (frames, 1, 2)), 0)
    return pose + path, np.ones((frames, K))


@pytest.mark.parametrize("frames", [1, 2, 26, 27, 28, 61, 200])
@pytest.mark.parametrize("stride", [1, 2, 3])
def test_windows_cover_every_frame(frames: int, stride: int) -> None:
    covered = np.concatenate(
        [r for p in range(min(stride, frames)) for r in window_rows(frames, stride, p)]
    )
    assert set(range(frames)) <= set(covered.tolist())


@pytest.mark.parametrize("fps", [12.5, 30.0, 120.0])
@pytest.mark.parametrize("frames", [1, 5, 40, 90])
def test_an_answer_for_every_frame(network: Lifter, frames: int, fps: float) -> None:
    lifted = lift(network, *walk(frames), fps)
    assert lifted.joints.shape == lifted.alternative.shape == (frames, 24, 3)
    assert np.isfinite(lifted.joints).all()
    assert np.isfinite(lifted.alternative).all()
    assert (lifted.sigma_m > 0).all()
    np.testing.assert_allclose(lifted.joints[:, 0], 0, atol=1e-7)


def test_a_faster_film_of_the_same_moments(network: Lifter) -> None:
    """Every frame doubled at twice the rate: the same motion."""
    rays, trust = walk(60)
    slow = lift(network, rays, trust, 15.0)
    fast = lift(network, rays.repeat(2, 0), trust.repeat(2, 0), 30.0)
    np.testing.assert_allclose(fast.joints[::2], slow.joints, atol=1e-5)


def test_a_film_in_a_mirror_shows_the_motion_in_a_mirror(network: Lifter) -> None:
    rays, trust = walk(50)
    trust[:, COMMON.index("left_wrist")] = 0.5
    flip, points = np.array([-1.0, 1.0, 1.0]), list(MIRROR)
    a = lift(network, rays, trust, 15.0)
    b = lift(network, rays[:, points] * flip[:2], trust[:, points], 15.0)
    joints = list(mirror_indices(SMPL_JOINTS))
    assert np.abs(a.joints - a.joints[:, joints] * flip).max() > 1e-3
    np.testing.assert_allclose(b.joints[:, joints] * flip, a.joints, atol=1e-5)
    np.testing.assert_allclose(b.alternative[:, joints] * flip, a.alternative, atol=1e-5)
    np.testing.assert_allclose(b.sigma_m[:, joints], a.sigma_m, atol=1e-5)


def test_no_point_no_matter(network: Lifter) -> None:
    """Junk without confidence changes nothing, nor does a frame's being seen elsewhere."""
    rays, trust = walk(50)
    trust[10:14] = 0.0
    junk = np.where(trust[..., None] > 0, rays, 5.0)
    a, b = lift(network, rays, trust, 15.0), lift(network, junk, trust, 15.0)
    np.testing.assert_array_equal(a.joints, b.joints)
    assert a.visible.sum() == 46


def test_faults_are_named_together(network: Lifter) -> None:
    rays, trust = walk(4)
    with pytest.raises(ValueError, match=r"rays: expected .*fps: expected") as caught:
        lift(network, rays[:, :3], trust, 0.0)
    assert "(4, 3, 2)" in str(caught.value)
    with pytest.raises(ValueError, match="finite"):
        lift(network, np.where(rays > 0, np.nan, rays), trust, 30.0)


def test_an_alternative_goes_on_where_windows_overlap() -> None:
    """Two motions offered in shuffled order come out unshuffled."""
    rng = np.random.default_rng(3)
    L, hop, count = WINDOW, WINDOW // 3, 6
    long = torch.as_tensor(rng.normal(size=(2, hop * count + L, 24, 3)))
    rows = [slice(hop * b, hop * b + L) for b in range(count)]
    order = rng.integers(0, 2, count)
    offered = torch.stack(
        [long[[o, 1 - o], r].transpose(0, 1) for o, r in zip(order, rows, strict=True)]
    )
    mean = long.mean(0)
    stitched = stitch_alternatives(torch.stack([mean[r] for r in rows]), offered, hop)
    which = [torch.equal(stitched[b], long[0, r]) for b, r in enumerate(rows)]
    other = [torch.equal(stitched[b], long[1, r]) for b, r in enumerate(rows)]
    assert all(which) or all(other)

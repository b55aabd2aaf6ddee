"""A video through the network: every frame once, in the camera's axes."""

import numpy as np
import pytest
import torch

from imocap_core.conventions import SMPL_JOINTS, mirror_indices
from imocap_core.lifter.infer import lift, stitch_alternatives, window_rows
from imocap_core.lifter.lifter_network import COMMON, MIRROR, WINDOW, Lifter

K = len(COMMON)


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

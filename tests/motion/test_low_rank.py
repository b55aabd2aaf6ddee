"""Laws of the low-rank step and of moving between time axes."""

import numpy as np
import pytest
import torch

from imocap_core.motion.multiview.alternation import (
    Alternation,
    LoopRound,
    LoopSteps,
    alternate,
    mean_change,
)
from imocap_core.motion.multiview.low_rank import low_rank_paths, low_rank_poses, low_rank_rows
from imocap_core.motion.multiview.timeline import (
    make_timeline,
    sample,
    sample_keypoints,
    sample_rotations,
)
from imocap_core.rotations import exp, geodesic_angle


def rotations(*size: int, spread: float = 0.4) -> torch.Tensor:
    generator = torch.Generator().manual_seed(1)
    return exp(spread * torch.randn(*size, 3, generator=generator, dtype=torch.float64))


@pytest.mark.parametrize("rank", [1, 2, 3])
def test_rows_have_the_rank_and_are_the_nearest(rank: int) -> None:
    rows = torch.randn(5, 8, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    found = low_rank_rows(rows, torch.ones(5, dtype=torch.float64), rank)
    centred = found - found.mean(0)
    assert int(torch.linalg.matrix_rank(centred, atol=1e-9)) == rank - 1
    singular = torch.linalg.svdvals(rows - rows.mean(0))
    assert float((rows - found).square().sum()) == pytest.approx(
        float(singular[rank - 1 :].square().sum())
    )


def test_equal_poses_are_their_own_low_rank() -> None:
    R = rotations(1, 6, 24).expand(4, -1, -1, -1, -1)
    for rank in (1, 2):
        Z = low_rank_poses(R, torch.ones(4, 6, 24, dtype=torch.float64), rank)
        assert float(geodesic_angle(Z, R).max()) < 1e-6


def test_full_rank_returns_every_video() -> None:
    R = rotations(1, 6, 24) @ rotations(3, 6, 24, spread=0.2)
    Z = low_rank_poses(R, torch.ones(3, 6, 24, dtype=torch.float64), 3)
    assert float(geodesic_angle(Z, R).max()) < 1e-6


def test_a_released_video_does_not_move_the_mean() -> None:
    R = rotations(1, 6, 24).expand(3, -1, -1, -1, -1).clone()
    R[2] = rotations(6, 24, spread=1.0)
    weight = torch.ones(3, 6, 24, dtype=torch.float64)
    weight[2] = 0
    assert float(geodesic_angle(low_rank_poses(R, weight, 1)[2], R[0]).max()) < 1e-6


def test_paths_complete_missing_frames_with_the_others() -> None:
    path = torch.randn(1, 10, 3, dtype=torch.float64).expand(3, -1, -1).clone()
    weight = torch.ones(3, 10, dtype=torch.float64)
    weight[1, :4] = 0
    path[1, :4] = 99.0
    assert torch.allclose(low_rank_paths(path, weight, 2)[1], path[0])


def test_timeline_inverts_a_warp() -> None:
    own = np.arange(40.0)
    to_reference = 3 + 0.5 * own
    timeline = make_timeline([np.arange(30.0), to_reference], [np.ones(30), np.ones(40)], 30)
    grid = np.arange(3, 23)
    np.testing.assert_allclose(timeline.from_reference[1, grid], (grid - 3) / 0.5)
    assert np.isnan(timeline.from_reference[1, :2]).all()
    assert (timeline.confidence[1, :2] == 0).all()


def test_a_hold_is_represented_by_its_middle() -> None:
    to_reference = np.array([0.0, 1.0, 2.0, 2.0, 2.0, 3.0])
    timeline = make_timeline([to_reference], [np.ones(6)], 4)
    assert timeline.from_reference[0, 2] == pytest.approx(3.0)


def test_sampling_at_whole_frames_is_exact_and_between_them_geodesic() -> None:
    R = rotations(5, 24)
    assert (
        float(geodesic_angle(sample_rotations(R, np.array([0.0, 2.0, 4.0])), R[[0, 2, 4]]).max())
        < 1e-7
    )
    middle = sample_rotations(R, np.array([1.5]))[0]
    first, second = geodesic_angle(R[1], middle), geodesic_angle(middle, R[2])
    assert torch.allclose(first, second, atol=1e-9)
    line = torch.arange(5, dtype=torch.float64)[:, None]
    assert torch.allclose(
        sample(line, np.array([0.25, 3.5]))[:, 0], torch.tensor([0.25, 3.5]).double()
    )
    alone = np.array([0.0, np.nan, 3.0])
    assert torch.equal(sample(line[2:3], alone), line[[2, 2, 2]])
    assert torch.allclose(sample_rotations(R[:1], alone), R[[0, 0, 0]])


def test_missing_keypoints_are_never_blended_in() -> None:
    xy = np.array([[[0.0, 0.0]], [[np.nan, np.nan]], [[4.0, 0.0]]])
    weight = np.array([[1.0], [0.0], [1.0]])
    value, strength = sample_keypoints(xy, weight, np.array([0.0, 0.5, 1.0, np.nan]))
    np.testing.assert_allclose(value[:2, 0, 0], [0.0, 0.0])
    np.testing.assert_allclose(strength[:, 0], [1.0, 0.5, 0.0, 0.0])


def rounds(
    costs: list[float], maps: list[float], limit: int, least: int = 0
) -> Alternation[np.ndarray, list[np.ndarray], float]:
    """An alternation whose rounds have these costs and these correspondences."""
    cost, place = iter(costs), dict(zip([9.0, *costs], maps, strict=False))
    steps = LoopSteps(
        lambda: np.zeros(4),
        lambda motion: np.full(4, place[motion]),
        lambda sync, motion: next(cost),
        outline=lambda sync: [sync],
        maps=lambda outline: outline,
        cost=lambda motion: motion,
    )
    first = LoopRound([np.zeros(4)], 9.0, 9.0, 0.0)
    return alternate(first, steps, max_rounds=limit, settled_frames=0.1, least_rounds=least)


def test_alternation_stops_when_the_correspondences_settle() -> None:
    done = rounds([3.0, 3.5], [2.0, 2.5, 2.55], 5)
    assert [t.cost for t in done.rounds] == [9.0, 3.0, 3.5]
    assert [t.change_frames for t in done.rounds] == [0.0, 2.0, 0.5]
    assert done.best == 2
    assert done.status.startswith("converged")
    assert done.status.endswith("the result is that of round 2")
    np.testing.assert_array_equal(done.sync, np.full(4, 2.55))  # as the last motion tells it


def test_alternation_returns_the_cheapest_round_when_it_diverges() -> None:
    done = rounds([3.0, 30.0], [2.0, 9.0], 2)
    assert done.best == 1
    np.testing.assert_array_equal(done.sync, np.full(4, 2.0))
    assert "the result is that of round 1, because later ones" in done.status


def test_a_round_that_loses_frames_is_not_kept_for_being_cheap() -> None:
    lost = np.array([2.0, np.nan, np.nan, 2.0])
    steps = LoopSteps(
        lambda: np.zeros(4), lambda motion: lost, lambda sync, motion: 1.0,
        outline=lambda sync: [sync], maps=lambda outline: outline, cost=lambda motion: motion,
    )  # fmt: skip
    first = LoopRound([np.zeros(4)], 9.0, 9.0, 0.0)
    done = alternate(first, steps, max_rounds=1, settled_frames=0.1)
    assert [t.cost for t in done.rounds] == [9.0, 1.0]
    assert done.best == 0
    np.testing.assert_array_equal(done.sync, np.zeros(4))  # as a whole, asked for in the end


def test_correspondences_do_not_settle_before_the_least_rounds() -> None:
    at_once = [0.0, 0.0, 0.0]
    assert len(rounds([3.0, 3.5], at_once, 2).rounds) == 1
    done = rounds([3.0, 3.5], at_once, 2, least=1)
    assert [t.cost for t in done.rounds] == [9.0, 3.0]
    assert done.status.startswith("converged")


def test_alternation_without_rounds_is_the_single_pass() -> None:
    assert rounds([], [], 0).best == 0


def test_change_counts_frames_that_lose_their_match() -> None:
    a, b = np.array([0.0, 1.0, np.nan]), np.array([0.5, np.nan, np.nan])
    assert mean_change([a], [b]) == pytest.approx((0.5 + 1) / 2)
    assert mean_change([a], [a]) == 0.0

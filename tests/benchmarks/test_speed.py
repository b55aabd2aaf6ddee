"""The rivals give our answers; growth and ratios are what the table says."""

import numpy as np
import pytest

from benchmarks import speed_rivals
from benchmarks.solver_race import made_scene
from benchmarks.speed import RatioRow, with_growth
from imocap_core.motion.gauss_newton import objective
from imocap_core.params import FitParams, MotionParams
from imocap_core.sync.procrustes import procrustes_distances
from imocap_core.sync.warp.dtw import dtw


def test_the_loop_of_decompositions_gives_our_distances() -> None:
    a, b = (np.random.default_rng(k).normal(size=(5 + k, 9, 3)) for k in range(2))
    ours = procrustes_distances(a, b, np.ones(a.shape[:2]), np.ones(b.shape[:2]))
    np.testing.assert_allclose(speed_rivals.procrustes_by_svd(a, b), ours, atol=1e-9)


@pytest.mark.parametrize("lengths", [(1, 1), (1, 6), (12, 9), (20, 31)])
def test_the_loops_of_time_warping_find_our_path(lengths: tuple[int, int]) -> None:
    a, b = (np.random.default_rng(n).normal(size=n).cumsum() for n in lengths)
    path, cost = speed_rivals.dtw_by_loops(a, b)
    ours, least = dtw((a[:, None] - b) ** 2)
    assert cost == pytest.approx(least)
    np.testing.assert_array_equal(path, ours)


FRAMES = 3  # the fewest with accelerations


@pytest.fixture(scope="module")
def alone() -> speed_rivals.MotionAlone:
    return speed_rivals.motion_alone(made_scene(2, FRAMES, FitParams(), 5), MotionParams())


def test_the_residuals_of_a_motion_alone_are_the_objective_s(
    alone: speed_rivals.MotionAlone,
) -> None:
    rng = np.random.default_rng(1)
    x, along = rng.normal(0.0, [[0.05], [1.0]], (2, FRAMES * 75))

    def residuals(step: float) -> np.ndarray:
        return np.concatenate([r.numpy().ravel() for r, _ in alone.rows(x + step * along)])

    u = residuals(0.0)
    assert u @ u == pytest.approx(float(objective(alone.terms, alone.state(x)).sum()))
    jacobian = speed_rivals.SparsePattern.of(alone).matrix([J.numpy() for _, J in alone.rows(x)])
    slope = (residuals(1e-6) - residuals(-1e-6)) / 2e-6
    np.testing.assert_allclose(jacobian @ along, slope, atol=1e-5)


@pytest.mark.parametrize("solve", [speed_rivals.scipy_solve, speed_rivals.ceres_solve])
def test_general_solvers_find_our_motion_alone(
    alone: speed_rivals.MotionAlone, solve: speed_rivals.Race
) -> None:
    if solve is speed_rivals.ceres_solve:
        pytest.importorskip("pyceres")
    ours = speed_rivals.gauss_newton_alone(alone.terms, alone.start)
    watch = speed_rivals.Stopwatch(1.01 * ours.costs[-1], limit_s=60.0)
    solve(alone, watch)
    assert watch.reached
    assert ours.costs[0] > 2.0 * watch.lowest


def test_growth_is_the_exponent() -> None:
    made = [RatioRow("p", "r", str(n), 2.0 * n**2, 5.0 * n**3, 1.0) for n in (3, 6, 12)]
    grown = with_growth(made, (3, 6, 12))
    assert np.isnan(grown[0].growth)
    assert [row.growth for row in grown[1:]] == pytest.approx([2.0, 2.0])
    assert [row.rival_growth for row in grown[1:]] == pytest.approx([3.0, 3.0])

"""The solver's benchmark and the rivals: scenes are what they claim, clocks stop, answers agree."""

import numpy as np
import pytest
import torch

from benchmarks import solver_race, speed_rivals
from benchmarks.solver import measure_size
from benchmarks.solver_race import made_scene
from benchmarks.speed import RatioRow, with_growth
from imocap_core.motion.gauss_newton import gauss_newton, objective
from imocap_core.params import FitParams, MotionParams
from imocap_core.sync.procrustes import procrustes_distances
from imocap_core.sync.warp.dtw import dtw

FIT = FitParams()
MOTION = MotionParams(max_steps=1)


def test_a_made_scene_is_seen_whole_and_starts_near() -> None:
    made = solver_race.made_scene(3, 25, FIT, 0)
    assert made.start.R_local.shape == (3, 25, 24, 3, 3)
    xyz = made.scene.body.positions(made.scene.body.keypoints, made.start)
    assert float((xyz[..., 2] - solver_race.DISTANCE_M).abs().max()) < 2.0
    xy = xyz[..., :2] / xyz[..., 2:] * solver_race.K[0, 0] + torch.as_tensor(solver_race.K[:2, 2])
    away = np.abs(np.stack([o.xy_px for o in made.scene.observations]) - xy.numpy())
    assert solver_race.NOISE_PX < np.median(away) < 30 * solver_race.NOISE_PX
    again = solver_race.made_scene(3, 25, FIT, 0)
    assert torch.equal(again.start.R_local, made.start.R_local)
    other = solver_race.made_scene(3, 25, FIT, 1)
    assert not torch.equal(other.start.R_local, made.start.R_local)


def test_a_race_ends_for_everybody_and_gauss_newton_is_its_measure() -> None:
    made = solver_race.made_scene(2, 4, FIT, 0)
    rows = solver_race.race(made, MOTION, most_times=2.0)
    assert [row.solver for row in rows] == [solver_race.NEWTON, "lbfgs", "adam"] * 2
    for row in rows:
        assert row.reached == (row.above_pct <= 0.1 + 1e-9)
        if row.solver == solver_race.NEWTON:
            assert row.reached
            assert row.times == 1.0


def test_a_rival_out_of_time_is_said_not_to_have_got_there() -> None:
    made = solver_race.made_scene(2, 6, FIT, 0)
    terms, start = solver_race.first_common_problem(made, MOTION, rigid_offsets=False)
    row = solver_race.timed("p", "s", gauss_newton_once, terms, start, target=1e-3, limit_s=1e-9)
    assert not row.reached
    assert row.evaluations == 1
    lowest = solver_race.newton(terms, start).costs[-1]
    there = solver_race.timed(
        "p", "s", solver_race.newton, terms, start, target=1.001 * lowest, limit_s=1e9
    )
    assert there.reached
    assert there.above_pct <= 0.1


def gauss_newton_once(terms, start):  # type: ignore[no-untyped-def]
    return gauss_newton(terms, start, max_steps=1)


def test_growth_counts_time_and_memory() -> None:
    row = measure_size(FIT, MOTION, 0, 2, 8)
    assert row.processor_s > 0
    assert row.processor_ms_per_frame == pytest.approx(1e3 * row.processor_s / 16)
    assert 0.1 < row.peak_gb < 16


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

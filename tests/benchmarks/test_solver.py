"""The solver's benchmark and the rivals: scenes are what they claim, clocks stop, answers agree;
the cost model finds what costs were made of."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks import solver_race, speed_rivals
from benchmarks.cost import (
    DETECTION_S,
    DOLLARS_A_CORE_HOUR,
    FPS,
    MBIT_PER_S,
    TERMS,
    CostModel,
    fitted,
    models_of,
    of_actions,
    scaled,
)
from benchmarks.cost_action import SIZE, ActionSize, made_clip
from benchmarks.cost_stages import STAGES, CostTimer, StageCost, make_store, processor_seconds
from benchmarks.parallel import LineDisplay
from benchmarks.solver import measure_size
from benchmarks.solver_race import made_scene
from benchmarks.speed import RatioRow, with_growth
from imocap_core.artifacts.store import cached_results
from imocap_core.motion.gauss_newton import gauss_newton, objective
from imocap_core.params import FitParams, MotionParams
from imocap_core.pipeline.make_demo import demo_body
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


TRUTH = CostModel(dict(zip(TERMS, (1.5, 0.4, 0.03, 2e-4, 0.2, 5e-6), strict=True)))
SIZES = [(2, 100, 25), (2, 300, 18), (4, 150, 25), (8, 150, 33), (4, 600, 25), (16, 300, 25)]
SIZES += [(8, 1000, 25)]


def row(size: tuple[int, int, int], stage: str, seconds: float) -> StageCost:
    return StageCost(*size, stage, seconds, seconds, 100.0 + size[0] * size[1], 2.0 * seconds, 1.0)


def rows() -> list[StageCost]:
    return [
        row(size, stage, factor * TRUTH.at(size))
        for size in SIZES
        for stage, factor in (("sync", 1.0), ("smpl_ba", 3.0))
    ]


def test_a_model_finds_the_coefficients_and_an_unseen_size() -> None:
    model = fitted(SIZES, [TRUTH.at(size) for size in SIZES])
    assert model.coefficients == pytest.approx(TRUTH.coefficients, rel=1e-6)
    assert model.at((12, 700, 25)) == pytest.approx(TRUTH.at((12, 700, 25)))


def test_no_coefficient_is_negative() -> None:
    falling = [100.0 / (size[0] * size[1]) for size in SIZES]
    assert min(fitted(SIZES, falling).coefficients.values()) >= 0.0


def test_costs_of_nothing_are_refused() -> None:
    with pytest.raises(ValueError, match="expected positive"):
        fitted(SIZES, [0.0] * len(SIZES))


def test_an_action_is_the_sum_of_its_stages_and_its_peak_the_largest() -> None:
    measured = rows()
    measured[0] = replace(measured[0], peak_mb=5000.0)
    cost = of_actions(measured)[SIZES[0]]
    assert cost.processor_s == pytest.approx(4 * TRUTH.at(SIZES[0]))
    assert cost.peak_mb == 5000.0
    assert models_of(rows()).at(SIZES[2]).stored_mb == pytest.approx(8 * TRUTH.at(SIZES[2]))


def test_many_actions_are_so_many_times_one() -> None:
    models, size = models_of(rows()), (8, 300, 25)
    cost = scaled(models, 1000, size)
    assert cost.detection_h == pytest.approx(1000 * 2400 * DETECTION_S / 3600)
    assert cost.stages_h == pytest.approx(1000 * models.at(size).processor_s / 3600)
    assert cost.core_dollars == pytest.approx(
        DOLLARS_A_CORE_HOUR * (cost.detection_h + cost.stages_h)
    )
    assert cost.films_gb == pytest.approx(2400 / FPS * MBIT_PER_S / 8)
    assert cost.hours(2) == pytest.approx(cost.hours(1) / 2)


def test_a_made_clip_has_its_frames_and_keypoints_in_the_picture() -> None:
    clip = made_clip(ActionSize(3, 24, "coco18"), 2, demo_body(7))
    assert clip.detections.xy_px.shape == (24, 18, 2)
    inside = ((clip.xy_px > 0) & (clip.xy_px < np.array(SIZE))).all(axis=-1)
    assert inside.mean() > 0.9
    assert np.all(np.diff(clip.motion.phase) > 0)


def test_a_timer_records_what_was_used_since_it_began() -> None:
    timer = CostTimer(LineDisplay(), ActionSize(2, 5))
    timer.begin()
    began = processor_seconds()
    while processor_seconds() < began + 0.1:
        pass
    timer.end("sync", 3_000_000)
    assert timer.rows[0].processor_s > 0.09
    assert timer.rows[0].stored_mb == 3.0
    assert timer.rows[0].keypoints == 25


def test_a_made_store_is_one_to_the_program(tmp_path: Path) -> None:
    make_store(tmp_path, 3)
    results = cached_results(tmp_path)
    assert len(results) == 3 * STAGES
    assert all(result.in_use for result in results)

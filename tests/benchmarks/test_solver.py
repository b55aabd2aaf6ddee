"""The solver's benchmark: its scenes are what they claim, its clocks stop, its table is honest."""

import numpy as np
import pytest
import torch

from benchmarks import solver_race
from benchmarks.solver import measure_size
from imocap_core.motion.gauss_newton import gauss_newton
from imocap_core.params import FitParams, MotionParams

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

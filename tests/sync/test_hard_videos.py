"""What Internet video does to time: slow motion, frames shown twice, clips that share only a part,
long holds of unequal length; and every cycle method with either warp."""

from dataclasses import replace

import numpy as np
import pytest

from imocap_core.params import SyncParams
from imocap_core.sync import SyncEvidence, SyncResult, affinity, synchronise
from imocap_core.sync.maps import BandedMap, refined_bands
from tests.sync.test_synchronise import FPS, PARAMS, error_s, estimated, run

SLOW_FPS = 15.0


@pytest.mark.parametrize(("max_rate", "reference"), [(4.0, None), (np.inf, 1)])
def test_a_video_at_a_quarter_of_the_speed(max_rate: float, reference: int | None) -> None:
    """Beyond the largest rate it is no reference, unless it was given as such."""
    # the second at a quarter of the speed
    rng = np.random.default_rng(20)
    phases = [np.linspace(1.0, 4.0, 45), np.linspace(1.2, 3.8, 156), np.linspace(0.9, 4.2, 48)]
    poses = [estimated(p, rng) for p in phases]
    params = replace(PARAMS, max_rate=max_rate)
    result = run(poses, params, reference=reference, fps=[SLOW_FPS] * 3)
    assert (result.reference == 1) == (reference == 1)
    assert error_s(phases, result.reference_frame, result.reference).mean() < 0.06
    other = 0 if reference == 1 else 1
    f = result.reference_frame[other]
    rate = np.polyfit(np.flatnonzero(np.isfinite(f)), f[np.isfinite(f)], 1)[0]
    assert rate == pytest.approx(0.25 if other == 1 else 4.0, rel=0.1)
    assert result.screening.outliers == ()


def test_three_frame_rates_give_one_axis_in_seconds() -> None:
    rng = np.random.default_rng(21)
    rates = [12.0, 25.0, 50.0]
    phases = [np.arange(0.3 * v, 3.0 + 0.3 * v, 1 / f) for v, f in enumerate(rates)]
    result = run([estimated(p, rng) for p in phases], fps=rates, reference=1)
    assert error_s(phases, result.reference_frame, 1).mean() < 0.04
    for p, phase in zip(phases, result.phase, strict=True):
        assert np.abs(phase - (p - phases[1][0])).mean() < 0.06


def test_frames_shown_twice_share_their_place() -> None:
    rng = np.random.default_rng(23)
    phase = np.linspace(0.5, 4.5, 100)
    poses = estimated(phase, rng)
    twice = np.repeat(poses, 2, axis=0)
    phases = [np.linspace(0.4, 4.6, 126), np.repeat(phase, 2)]
    result = run([estimated(phases[0], rng), twice], reference=0)
    assert error_s(phases, result.reference_frame, 0).mean() < 0.03


def test_clips_that_share_their_middle_match_there_alone() -> None:
    rng = np.random.default_rng(24)
    phases = [np.linspace(0.0, 4.0, 120), np.linspace(2.0, 6.0, 120)]
    result = run([estimated(p, rng, 0.02) for p in phases], reference=0)
    f, true = result.reference_frame[1], phases[1]
    assert np.isfinite(f[true < 3.8]).mean() > 0.95
    assert np.isnan(f[true > 4.3]).mean() > 0.9
    assert error_s(phases, result.reference_frame, 0).mean() < 0.06
    # the common axis goes on where the reference has ended
    late = true > 4.3
    assert np.abs(result.phase[1][late] - true[late]).mean() < 0.35


def test_a_longer_hold_is_crossed_at_one_pace() -> None:
    rng = np.random.default_rng(25)

    def held(frames: int) -> np.ndarray:
        return np.concatenate([np.linspace(0, 2, 50), np.full(frames, 2.0), np.linspace(2, 4, 50)])

    result = run([estimated(held(80), rng, 0.02), estimated(held(40), rng, 0.02)], reference=0)
    f = result.reference_frame[1]
    assert np.isfinite(f[1:-1]).all()  # its first and last frame may lie beside the other's
    assert np.abs(f[1:45] - np.arange(1, 45)).mean() < 1.0
    assert np.abs(f[95:-1] - np.arange(135, 179)).mean() < 1.0
    steps = np.diff(f[55:86])
    assert steps.mean() == pytest.approx(2.0, rel=0.25)
    assert steps.max() < 6.0


@pytest.mark.parametrize(
    ("method", "warp"),
    [(m, "posterior") for m in ("none", "als", "svt")] + [("none", "dtw"), ("als", "dtw")],
)
def test_every_cycle_method_with_either_warp(method: str, warp: str) -> None:
    rng = np.random.default_rng(26)
    phases = [
        np.linspace(1.0, 4.0, 60),
        1.0 + 3.0 * np.linspace(0, 1, 48) ** 1.3,
        1.0 + 3.0 * np.linspace(0, 1, 54) ** 0.8,
    ]
    chosen: SyncParams = replace(PARAMS, method=method, warp=warp, consensus_rounds=1)
    result = run([estimated(p, rng) for p in phases], chosen, reference=0)
    limit = 0.04 if warp == "posterior" else 0.12
    assert error_s(phases, result.reference_frame, 0).mean() < limit, result.status
    matched = np.isfinite(np.concatenate(result.reference_frame)).mean()
    assert matched > 0.9


def synchronised(phases: list[np.ndarray]) -> SyncResult:
    rng = np.random.default_rng(3)
    poses = [estimated(phase, rng) for phase in phases]
    params = replace(PARAMS, outliers="ignore", mirrored="ignore", consensus_rounds=1)
    return synchronise(SyncEvidence(poses, [FPS] * 2, reference=0), params, rng)


def test_maps_by_way_of_every_third_frame_are_those_of_all(monkeypatch: pytest.MonkeyPatch) -> None:
    phases = [np.linspace(1.0, 11.0, 300), np.linspace(0.0, 1.0, 280) ** 1.2 * 9.0 + 1.5]
    every = synchronised(phases)
    monkeypatch.setattr(affinity, "ALL_COMPARED", 300 * 280 // 9)
    coarse = synchronised(phases)
    assert coarse.affinity.pairs[0, 1].shape == (300, 280)
    assert np.median(error_s(phases, every.reference_frame, 0)) < 0.05
    np.testing.assert_allclose(
        coarse.reference_frame[1], every.reference_frame[1], rtol=0, atol=1e-3
    )
    np.testing.assert_allclose(coarse.confidence[1], every.confidence[1], rtol=0, atol=0.05)


def test_bands_of_all_frames_contain_those_of_every_nth() -> None:
    coarse = BandedMap.of(np.eye(50, 80))
    for rows, columns in refined_bands(coarse, (200, 320), 4, 5):
        assert columns.start <= max(0, rows.start - 5)
        assert min(320, rows.stop + 5) <= columns.stop < rows.stop + 64 * 4
    nowhere = BandedMap.of(np.zeros((50, 80)))
    assert all(c == slice(0, 320) for _, c in refined_bands(nowhere, (200, 320), 4, 5))

"""One time axis: the phases that maps between made clips must give."""

import numpy as np
import pytest

from imocap_core.sync.time_axis import (
    HARD_WEIGHT,
    PairMaps,
    WeightedMap,
    common_phase,
    composed,
    cycle_residuals,
    left_out_disagreement,
)
from tests.sync.phase_positions import positions_in

FPS = 25.0


def clip(first_s: float, last_s: float, fps: float) -> np.ndarray:
    """Times (T,) of the frames of a clip."""
    return np.arange(first_s, last_s, 1.0 / fps)


def true_map(i: int, j: int, times: list[np.ndarray], weight: float = 1.0) -> WeightedMap:
    """The true positions of the frames of clip i in clip j; NaN outside."""
    positions = np.interp(
        times[i], times[j], np.arange(len(times[j]), dtype=float), left=np.nan, right=np.nan
    )
    return WeightedMap(i, j, positions, weight * np.isfinite(positions))


def every_map(times: list[np.ndarray]) -> list[WeightedMap]:
    M = len(times)
    return [true_map(i, j, times) for i in range(M) for j in range(M) if i != j]


def lengths(times: list[np.ndarray]) -> list[int]:
    return [len(t) for t in times]


def test_true_maps_give_the_true_phases() -> None:
    times = [clip(0, 4, FPS), clip(1, 5, 30.0), clip(-1, 3, 50.0)]
    phases = common_phase([FPS, 30.0, 50.0], lengths(times), 0, every_map(times))
    np.testing.assert_array_equal(phases[0], np.arange(100) / FPS)
    for phase, true in zip(phases, times, strict=True):
        inside = (true >= 0) & (true <= times[0][-1])
        np.testing.assert_allclose(phase[inside], true[inside], atol=2e-3)


def test_frames_that_only_other_videos_share_lie_outside_the_reference() -> None:
    times = [clip(0, 3, FPS), clip(1, 6, FPS), clip(2, 7, FPS)]
    phases = common_phase([FPS] * 3, lengths(times), 0, every_map(times))
    for v in (1, 2):
        np.testing.assert_allclose(phases[v], times[v], atol=0.02)
    assert phases[1][-1] > 2 * phases[0][-1] - 0.5


def test_a_chain_of_videos_reaches_one_that_the_reference_never_meets() -> None:
    times = [clip(0, 3, FPS), clip(2, 5, FPS), clip(4, 7, FPS)]
    maps = [true_map(i, j, times) for i, j in ((0, 1), (1, 0), (1, 2), (2, 1))]
    phases = common_phase([FPS] * 3, lengths(times), 0, maps)
    np.testing.assert_allclose(phases[2], times[2], atol=0.02)


def test_a_video_without_any_map_has_no_phase() -> None:
    times = [clip(0, 3, FPS), clip(0, 3, FPS), clip(0, 3, FPS)]
    maps = [true_map(0, 1, times), WeightedMap(2, 0, np.full(75, np.nan), np.zeros(75))]
    phases = common_phase([FPS] * 3, lengths(times), 0, maps)
    assert np.isfinite(phases[1]).all()
    assert np.isnan(phases[2]).all()


@pytest.mark.parametrize("seed", range(3))
def test_maps_through_phases_close_every_cycle_and_outliers_do_not_bend_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    times = [clip(0, 4, FPS), clip(0.2, 4.4, FPS), clip(-0.3, 3.8, 30.0)]
    maps = []
    for k in every_map(times):
        off = k.positions + rng.normal(0, 0.5, len(k.positions))
        off[40:52] += 20.0 * (k.i == 1 and k.j == 2)  # a dozen frames gone astray in one map
        maps.append(WeightedMap(k.i, k.j, off, k.weights))
    phase = common_phase([FPS, FPS, 30.0], lengths(times), 0, maps)
    for p, true in zip(phase, times, strict=True):
        assert (np.diff(p) >= 0).all()
        shared = (true > 0.2) & (true < 3.8)
        assert np.abs(p - true)[shared].max() < 0.06
    on = positions_in(phase[1], phase[2])
    back = positions_in(np.interp(on, np.arange(len(phase[2])), phase[2]), phase[1])
    matched = np.isfinite(back)
    assert matched.mean() > 0.8
    assert np.abs(back - np.arange(len(back)))[matched].max() < 0.75  # where phases pause, a frame


def test_a_hard_weight_prevails_against_all_evidence() -> None:
    times = [clip(0, 4, FPS), clip(0, 4, FPS), clip(0, 4, FPS)]
    hard, weight = np.full(100, np.nan), np.zeros(100)
    hard[50], weight[50] = 56.0, HARD_WEIGHT
    maps = [*every_map(times), WeightedMap(1, 2, hard, weight)]
    phase = common_phase([FPS] * 3, lengths(times), 0, maps)
    assert abs(positions_in(phase[1][50:51], phase[2])[0] - 56.0) < 0.5
    assert abs(phase[1][10] - times[1][10]) < 0.02


def shifted(offsets: list[float], length: int = 60) -> PairMaps:
    """Clips of one motion that start at `offsets` (frames): consistent maps."""
    frames = np.arange(length, dtype=float)
    positions = {
        (i, j): np.where(
            (frames + a - b >= 0) & (frames + a - b <= length - 1), frames + a - b, np.nan
        )
        for i, a in enumerate(offsets)
        for j, b in enumerate(offsets)
        if i != j
    }
    return PairMaps(positions, {k: np.isfinite(p).astype(float) for k, p in positions.items()})


def test_consistent_maps_close_their_cycles_and_agree() -> None:
    pairs = shifted([0.0, 3.5, 7.0, -2.0])
    triples = cycle_residuals(pairs, [60] * 4, [30.0] * 4)
    assert len(triples) == 4
    for t in triples:
        assert t.frames < 1e-9
        assert 0.7 < t.share <= 1.0
    off, share = left_out_disagreement(pairs, [60] * 4, 0)
    assert np.isnan(off[0])
    assert (off[1:] < 1e-9).all()
    assert (share[1:] > 0.7).all()


def test_a_wrong_map_shows_in_its_cycles_and_nowhere_else() -> None:
    pairs = shifted([0.0, 0.0, 0.0, 0.0])
    pairs.positions[1, 2] = np.minimum(pairs.positions[1, 2] + 6.0, 59.0)
    pairs.positions[2, 1] = np.maximum(pairs.positions[2, 1] - 6.0, 0.0)
    for t in cycle_residuals(pairs, [60] * 4, [30.0, 30.0, 30.0, 30.0]):
        if {1, 2} <= set(t.videos):
            assert 4.0 < t.frames < 6.5
            assert abs(t.seconds - t.frames / 30.0) < 1e-12
        else:
            assert t.frames < 1e-9


def test_the_video_whose_direct_map_differs_is_the_one_that_disagrees() -> None:
    pairs = shifted([0.0] * 5)
    pairs.positions[2, 0] = np.minimum(pairs.positions[2, 0] + 5.0, 59.0)
    off, _ = left_out_disagreement(pairs, [60] * 5, 0)
    assert 4.0 < off[2] < 5.1
    assert off[1] < 0.01  # the median over the ways leaves the wrong one out
    assert off[3] < 0.01


def test_two_videos_have_no_cycle_residual() -> None:
    pairs = shifted([0.0, 1.0])
    assert cycle_residuals(pairs, [60, 60], [30.0, 30.0]) == []
    off, share = left_out_disagreement(pairs, [60, 60], 0)
    assert np.isnan(off).all()
    assert np.isnan(share).all()


def test_composition_interpolates_and_loses_unmatched_frames() -> None:
    then = np.array([0.0, 2.0, np.nan, 6.0])
    got = composed(np.array([0.0, 0.5, 1.0, 1.5, 3.0, np.nan]), then)
    np.testing.assert_allclose(got, [0.0, 1.0, 2.0, np.nan, 6.0, np.nan])

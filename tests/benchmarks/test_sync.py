"""The parts of the sync benchmark: scores of known maps, tables."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import sync
from benchmarks.sync_scenes import SyncScene
from benchmarks.tcc import POSES


def scene() -> SyncScene:
    """Two videos of 101 phases; the second starts 5 later."""
    phases = [np.arange(101.0), np.arange(5.0, 95.0)]
    poses = [np.zeros((len(p), 14, 3)) for p in phases]
    return SyncScene("made", poses, phases, [30.0, 30.0], 100.0, events=[50, 45])


def test_true_maps_score_zero_and_shifted_ones_their_shift() -> None:
    made = scene()
    reference_map, true = np.arange(101.0), np.arange(90.0) + 5.0
    assert sync.score_maps(made, 0, [reference_map, true]).error_pct == 0.0
    shifted = sync.score_maps(
        made, 0, [reference_map, true + 2.0], [np.ones(101), np.full(90, 0.5)]
    )
    assert shifted.error_pct == pytest.approx(2.0)
    assert shifted.within_one == 0.0
    assert shifted.confidence == 0.5
    assert sync.pair_error_pct(made, 1, 0, true - 1.0) == pytest.approx(1.0)


def test_an_unmatched_event_is_infinitely_far() -> None:
    made = scene()
    estimate = np.arange(90.0) + 6.0
    assert sync.event_errors_frames(made, 0, [np.arange(101.0), estimate]) == pytest.approx([1.0])
    estimate[45] = np.nan
    assert np.isinf(sync.event_errors_frames(made, 0, [np.arange(101.0), estimate])).all()


def test_the_confidence_is_held_against_the_errors() -> None:
    made = scene()
    reference_map, true = np.arange(101.0), np.arange(90.0) + 5.0
    estimate = true.copy()
    estimate[:45] += 6.0  # 0.2 s off
    trust = np.where(np.arange(90) < 45, 0.3, 0.95)
    estimate[80:] = np.nan
    pairs = sync.confidences_and_errors(made, 0, [reference_map, estimate], [np.ones(101), trust])
    assert len(pairs) == 80
    rows = {r.confidence: r for r in sync.calibration(pairs, 0.1)}
    assert list(rows) == ["0.2 to 0.4", "0.9 to 1.0", "0.0 to 1.0"]
    assert (rows["0.2 to 0.4"].within, rows["0.9 to 1.0"].within) == (0.0, 1.0)
    assert rows["0.2 to 0.4"].median_s == pytest.approx(0.2)
    assert rows["0.0 to 1.0"].frames == 80
    assert rows["0.0 to 1.0"].within == pytest.approx(35 / 80)


def test_rivals_answer_in_the_reference() -> None:
    rng = np.random.default_rng(0)
    phases = [np.linspace(0.0, 1.0, n) for n in (40, 30)]
    way = rng.normal(size=(14, 3))
    rest = rng.normal(size=(14, 3))
    poses = [rest + np.sin(5 * p)[:, None, None] * way for p in phases]
    made = SyncScene("made", poses, [100 * p for p in phases], [30.0, 25.0], 100.0)
    frames, _ = sync.rival("stretch", made, 0)
    np.testing.assert_allclose(frames[1], np.linspace(0.0, 39.0, 30))
    few = replace(POSES, steps=5)
    frames, trust = sync.rival("tcc", made, 0, tcc=few)
    np.testing.assert_array_equal(frames[0], np.arange(40.0))
    assert len(frames[1]) == len(trust[1]) == 30
    assert np.nanmax(frames[1]) <= 39.0
    with pytest.raises(ValueError, match="expected one of tcc, stretch"):
        sync.rival("guess", made, 0)

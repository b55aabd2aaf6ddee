"""Trust numbers on maps whose faults are known."""

import numpy as np

from imocap_core.sync.time_axis import PairMaps, composed, cycle_residuals, left_out_disagreement


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

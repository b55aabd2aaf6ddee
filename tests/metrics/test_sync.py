"""Synchronisation errors on maps that can be worked by hand."""

from itertools import permutations

import numpy as np
import pytest
from numpy.typing import ArrayLike

from imocap_core.metrics import sync

# The reference shows phases 0, 10, ..., 100 in its source frames 5, 6, ..., 15.
REFERENCE_FRAMES = np.arange(5, 16)
REFERENCE_PHASE = 10.0 * np.arange(11)


def _errors(matched: ArrayLike, phase: ArrayLike) -> sync.SyncErrors:
    return sync.sync_errors(
        np.asarray(matched), np.asarray(phase), REFERENCE_FRAMES, REFERENCE_PHASE, phase_end=200.0
    )


def test_true_position_interpolates_and_has_no_counterpart_outside() -> None:
    frames = sync.true_reference_frame(
        np.array([-1, 0, 25, 100, 101]), REFERENCE_FRAMES, REFERENCE_PHASE
    )
    np.testing.assert_array_equal(frames, [np.nan, 5, 7.5, 15, np.nan])


def test_errors_by_hand():
    # Phases 20 and 35 lie at reference frames 7 and 8.5; matched at 8 and 8: off by 1 and 0.5
    # frames, by 10 and 5 of 200 in phase.
    errors = _errors([8, 8], [20, 35])
    np.testing.assert_allclose(errors.frames, [1, 0.5])
    assert sync.sync_error_pct(errors) == pytest.approx(3.75)
    assert sync.sync_error_released_pct(errors) == pytest.approx(
        5.0
    )  # 20 alone is a reference phase
    assert sync.sync_error_frames(errors) == pytest.approx(0.75)
    assert sync.sync_median_error_frames(errors) == pytest.approx(0.75)
    assert sync.sync_error_ms(errors, reference_fps=25) == pytest.approx(30)


def test_the_true_map_has_no_error() -> None:
    phase = np.linspace(3, 97, 40)
    errors = _errors(sync.true_reference_frame(phase, REFERENCE_FRAMES, REFERENCE_PHASE), phase)
    assert sync.sync_error_pct(errors) == pytest.approx(0, abs=1e-12)
    assert sync.sync_error_frames(errors) == pytest.approx(0, abs=1e-12)
    assert sync.matched_share(errors) == 1
    assert np.isnan(
        sync.sync_error_released_pct(errors)
    )  # no frame of one falls on one of the other


def test_frames_without_counterpart_do_not_enter_the_mean() -> None:
    errors = _errors([5, 7, np.nan, 15, np.nan], [-30, 20, 30, 140, 150])
    assert sync.sync_error_frames(errors) == pytest.approx(0)
    assert sync.matched_share(errors) == pytest.approx(1 / 2)  # of phases 20 and 30
    assert sync.false_match_share(errors) == pytest.approx(2 / 3)  # of phases -30, 140 and 150


def test_percentage_does_not_see_the_unit_of_phase() -> None:
    matched, phase = np.array([8, 8]), np.array([20, 35])
    a = sync.sync_errors(matched, phase, REFERENCE_FRAMES, REFERENCE_PHASE, 100)
    b = sync.sync_errors(matched, phase / 100, REFERENCE_FRAMES, REFERENCE_PHASE / 100, 1)
    assert sync.sync_error_pct(a) == pytest.approx(sync.sync_error_pct(b))


def test_nothing_matched_is_nan_not_zero() -> None:
    errors = _errors([np.nan, np.nan], [20, 35])
    assert np.isnan(sync.sync_error_pct(errors))
    assert np.isnan(sync.sync_median_error_frames(errors))
    assert sync.matched_share(errors) == 0
    assert np.isnan(sync.false_match_share(errors))


def test_offset_by_hand() -> None:
    matched = np.array([3, 4, 5.5, np.nan])
    assert sync.offset_frames(matched, np.array([1, 2, 3, 4])) == pytest.approx(2)
    assert np.isnan(sync.offset_frames(np.array([np.nan]), np.array([1])))


@pytest.mark.parametrize("videos", [2, 3, 4])
def test_consistent_maps_come_back_to_where_they_started(videos: int) -> None:
    pairs = permutations(range(videos), 2)
    assert sync.cycle_residual_frames(dict.fromkeys(pairs, np.arange(6))) == 0
    assert np.isnan(sync.cycle_residual_frames({}))


def test_cycle_residual_by_hand():
    # There: frame t to t + 1 (the last stays); back: t to t. So all but one of the frames that
    # start in either video come back one too far, the other comes back at once.
    nearest = {(0, 1): np.array([1, 2, 3, 4, 5, 5]), (1, 0): np.arange(6)}
    assert sync.cycle_residual_frames(nearest) == 1


@pytest.mark.usefixtures("unchecked_shapes")
def test_misuse_is_named() -> None:
    one, two = np.array([1]), np.array([0, 1])
    with pytest.raises(ValueError, match="phase that rises"):
        sync.sync_errors(one, one, np.array([0, 1, 2]), np.array([0, 2, 1]), 1)
    with pytest.raises(ValueError, match="phase_end must be positive"):
        sync.sync_errors(one, one, two, two, 0)
    with pytest.raises(ValueError, match=r"both be \(T,\)"):
        sync.sync_errors(two, one, two, two, 1)


def test_a_repeated_reference_frame_is_no_fault():
    # The reference shows phase 10 twice: a frame of phase 10 may be matched to either.
    for matched in (1, 2):
        errors = sync.sync_errors(
            np.array([matched]), np.array([10]), np.arange(4), np.array([0, 10, 10, 20]), 20
        )
        assert sync.sync_error_pct(errors) == 0

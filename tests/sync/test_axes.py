"""Maps averaged over several axes: exact where all agree, nearer to the truth where they err."""

import numpy as np
import pytest

from imocap_core.sync.axes import averaged_over_axes, axes_of, inverted

LENGTHS = [60, 50, 70, 55]
REACH = 9.0


def warp(video: int, frames: np.ndarray) -> np.ndarray:
    """Phase of a video's frames: its own offset and pace."""
    return (frames + 2.0 * video) * (1.0 + 0.1 * video)


def frame_of(video: int, phase: np.ndarray) -> np.ndarray:
    """The inverse of `warp`."""
    return phase / (1.0 + 0.1 * video) - 2.0 * video


def maps_to(axis: int, error: float = 0.0) -> list[np.ndarray]:
    """True positions of all videos in one, as far as it reaches; the axis misplaced on the time of
    the action by `error`."""
    out = []
    for v, length in enumerate(LENGTHS):
        position = frame_of(axis, warp(v, np.arange(float(length)))) + error * (v != axis)
        inside = (position >= 0) & (position <= LENGTHS[axis] - 1)
        out.append(np.where(inside, position, np.nan))
    return out


@pytest.mark.parametrize("reference", range(4))
def test_axes_that_agree_change_nothing(reference: int) -> None:
    exact = {axis: maps_to(axis) for axis in range(4)}
    averaged = averaged_over_axes(exact, reference, LENGTHS, REACH)
    for before, after in zip(exact[reference], averaged, strict=True):
        np.testing.assert_allclose(after, before, atol=1e-9)


def test_an_error_of_the_reference_counts_as_one_of_the_axes() -> None:
    """All videos are placed 2 frames off in the reference, and rightly in each other."""
    maps = {0: maps_to(0, error=2.0), **{axis: maps_to(axis) for axis in (1, 2, 3)}}
    averaged = averaged_over_axes(maps, 0, LENGTHS, 1e6)
    within = slice(15, 30)  # away from the ends of all videos
    for v in (1, 2, 3):
        np.testing.assert_allclose((averaged[v] - maps_to(0)[v])[within], 2.0 / 4, atol=1e-9)


def test_an_axis_that_matches_another_repetition_hardly_counts() -> None:
    """Through the axis 1 everything lies 40 frames late."""
    exact = {axis: maps_to(axis) for axis in range(4)}
    late = [x + 40.0 * (v not in (0, 1)) for v, x in enumerate(maps_to(1))]
    averaged = averaged_over_axes({**exact, 1: late}, 0, LENGTHS, REACH)
    for v in (2, 3):
        error = np.abs(averaged[v] - maps_to(0)[v])[15:30]
        assert np.nanmax(error) < 0.05


def test_unmatched_frames_stay_so_and_no_axis_moves_time_backwards() -> None:
    rng = np.random.default_rng(0)
    maps = {
        axis: [np.maximum.accumulate(x + rng.normal(0, 0.7, len(x))) for x in maps_to(axis)]
        for axis in range(4)
    }
    averaged = averaged_over_axes(maps, 2, LENGTHS, REACH)
    for v in (0, 1, 3):
        matched = np.isfinite(averaged[v])
        np.testing.assert_array_equal(matched, np.isfinite(maps[2][v]))
        assert (np.diff(averaged[v][matched]) >= 0).all()


def test_inverse_of_a_map_and_of_its_plateaus() -> None:
    positions = np.array([np.nan, 0.0, 1.0, 1.0, 1.0, 2.5, np.nan])
    targets = np.array([-0.1, 0.0, 0.5, 1.0, 2.5, 2.6])
    expected = [np.nan, 1.0, 2.0, 3.0, 5.0, np.nan]
    np.testing.assert_allclose(inverted(positions, targets), expected)
    assert np.isnan(inverted(np.full(4, np.nan), targets)).all()


def test_the_reference_is_the_first_axis_and_the_most_central_follow() -> None:
    central = np.array([0.3, 0.9, 0.5, 0.7, 0.1])
    assert axes_of(2, central, most=3) == [2, 1, 3]
    assert axes_of(1, central[:2]) == [1, 0]

"""One offset a video from correspondences that partly contradict it, or from sound."""

from __future__ import annotations

import numpy as np
import pytest

from imocap_core.motion.event_clock import clock_of


def test_the_offset_is_what_most_matches_agree_on() -> None:
    reference = np.arange(100.0)
    other = np.arange(100.0) + 7.3 + 0.3 * np.sin(np.arange(100))
    other[60:] += 25.0  # a repetition later
    clock = clock_of([reference, other], [np.ones(100), np.ones(100)], [30.0, 30.0], 0)
    assert clock.offset == pytest.approx([0.0, -7.3], abs=0.1)
    assert clock.agreement == pytest.approx([1.0, 0.6])


def test_frame_rates_that_differ() -> None:
    seconds = np.arange(50) / 24.0 + 0.5
    clock = clock_of([np.arange(90.0), 30 * seconds], [np.ones(90), np.ones(50)], [30.0, 24.0], 0)
    assert clock.rate == pytest.approx([1.0, 0.8])
    assert clock.offset[1] == pytest.approx(-12.0, abs=0.01)
    lines = clock.reference_frames(1, 50, 89)
    inside = 30 * seconds <= 89.5
    assert lines[inside] == pytest.approx(np.minimum(30 * seconds[inside], 89.0))
    assert np.isnan(lines[~inside]).all()


def test_sound_decides_where_it_tells() -> None:
    maps = [np.arange(60.0), np.arange(60.0) + 4, np.arange(60.0) + 2]
    begun = np.array([10.0, 10.2, np.nan])
    clock = clock_of(maps, [np.ones(60)] * 3, [30.0] * 3, 0, begun)
    assert clock.offset == pytest.approx([0.0, -6.0, -2.0])
    assert clock.agreement == pytest.approx([1.0, 1.0, 1.0])


def test_a_video_without_matches_has_no_offset() -> None:
    clock = clock_of([np.arange(10.0), np.full(10, np.nan)], [np.ones(10)] * 2, [30.0] * 2, 0)
    assert np.isnan(clock.offset[1])
    assert clock.agreement[1] == 0

"""Offsets by sound: right within a frame, or not sure."""

from itertools import combinations

import numpy as np
import pytest
from scipy.signal import resample_poly

from imocap_core.sync.sound import (
    PairOffset,
    consistent_offsets,
    onset_envelope,
    pair_offset,
    pair_offsets,
)
from tests.io.made_sound import event, loop, recorded

FRAME_S = 1 / 30
BANDS = ((80.0, 8000.0), (300.0, 3400.0), (150.0, 6000.0), (500.0, 8000.0))


def envelope(sound):
    return onset_envelope(resample_poly(sound, 1, 3))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_offsets_of_different_microphones(seed, noise):
    rng = np.random.default_rng(seed)
    sound, starts = event(12.0, seed), rng.uniform(0.0, 5.0, 2)
    clips = [
        recorded(sound, start, 6.0, band_hz=BANDS[k], gain=0.1**k, noise=noise, seed=7 * seed + k)
        for k, start in enumerate(starts)
    ]
    pair = pair_offset(*map(envelope, clips))
    assert pair.sure
    assert abs(pair.offset_s - (starts[1] - starts[0])) < FRAME_S / 2


def test_an_offset_changes_its_sign_when_the_recordings_swap():
    sound = event(9.0)
    a, b = (
        envelope(recorded(sound, 0.4, 5.0)),
        envelope(recorded(sound, 1.7, 6.0, band_hz=BANDS[1])),
    )
    forth, back = pair_offset(a, b), pair_offset(b, a)
    assert forth.offset_s == pytest.approx(-back.offset_s, abs=1e-6)
    assert forth.ratio == pytest.approx(back.ratio, rel=1e-6)


@pytest.mark.parametrize("period_s", [0.5, 2.0])
def test_music_that_repeats_is_ambiguous(period_s):
    music = loop(14.0, period_s)
    pair = pair_offset(
        *(
            envelope(recorded(music, start, 6.0, band_hz=band))
            for start, band in ((0.3, BANDS[0]), (1.9, BANDS[2]))
        )
    )
    assert pair.common
    assert not pair.sure


@pytest.mark.parametrize("seed", range(4))
def test_other_events_are_not_sure(seed):
    pair = pair_offset(envelope(event(6.0, seed)), envelope(event(7.0, seed + 100)))
    assert not pair.sure


def test_silence_and_short_sounds_tell_nothing():
    assert pair_offset(np.zeros(500), envelope(event(4.0))) is None
    assert pair_offset(envelope(event(0.5)), envelope(event(4.0))) is None
    assert onset_envelope(np.zeros(10)).size == 0


def sure(offset_s):
    return PairOffset(offset_s, 0.0, 9.0, 99.0)


def test_offsets_of_all_recordings_agree():
    starts = np.array([0.0, 1.3, -0.4, 2.2])
    noise = 0.004 * np.random.default_rng(0).standard_normal((4, 4))
    pairs = {
        (a, b): sure(starts[b] - starts[a] + noise[a, b]) for a, b in combinations(range(4), 2)
    }
    np.testing.assert_allclose(consistent_offsets(pairs, 4), starts, atol=0.01)
    pairs[1, 3] = sure(5.0)  # that the others refute
    np.testing.assert_allclose(consistent_offsets(pairs, 4), starts, atol=0.01)


def test_recordings_that_no_sure_offset_ties_are_left_out():
    pairs = {(0, 1): sure(0.5), (1, 2): PairOffset(1.0, 2.0, 1.0, 99.0)}
    np.testing.assert_allclose(consistent_offsets(pairs, 3), [0.0, 0.5, np.nan], atol=1e-9)
    assert np.isnan(consistent_offsets({}, 2)).all()
    assert not pair_offsets([None, envelope(event(4.0))])

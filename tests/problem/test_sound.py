"""Films of one event: when each began, by its sound track, and the anchors that follow."""

import numpy as np
import pytest

from imocap_core.adapters.hints import event_sound, with_sound
from imocap_core.artifacts.schemas import Keypoints
from imocap_core.io.video import read_sound
from imocap_core.sync import Anchor, Hints
from tests.io.made_sound import RATE, event, loop, recorded, write_film
from tests.report.made import Made

STARTS = (0.0, 1.37, 0.52)
SECONDS, FPS = 6.0, 30.0


@pytest.fixture(scope="module")
def keypoints():
    """Three videos of 180 frames."""
    return Keypoints(
        videos=[v.model_copy(update={"fps": FPS}) for v in Made(3, frames=180).keypoints.videos]
    )


def films(folder, sound, starts=STARTS):
    bands = ((80.0, 8000.0), (300.0, 3400.0), (200.0, 6000.0))
    return {
        f"v{k + 1}": write_film(
            folder / f"v{k + 1}.mp4",
            recorded(sound, start, SECONDS, band_hz=bands[k], gain=0.3**k, noise=0.5, seed=k),
            SECONDS,
        )
        for k, start in enumerate(starts)
    }


def test_films_of_one_event_are_placed_within_a_frame(tmp_path, keypoints):
    heard = event_sound(films(tmp_path, event(9.0)), keypoints)
    np.testing.assert_allclose(heard.start_s, STARTS, atol=0.5 / FPS)
    assert heard.notes == ["by their sound, against the beginning of v1: v2 +1.37 s, v3 +0.52 s"]
    hints = with_sound(Hints(), heard.start_s, keypoints)
    assert len(hints.anchors) > 40
    for tie in hints.anchors:
        late = STARTS[tie.b] - STARTS[tie.a]
        a, b = (keypoints.videos[v].time_s for v in (tie.a, tie.b))
        time_b = np.interp(tie.frame_b, np.arange(len(b)), b)
        assert a[tie.frame_a] - time_b == pytest.approx(late, abs=0.5 / FPS)
        assert not tie.hard


def test_music_that_repeats_is_said_and_not_used(tmp_path, keypoints):
    heard = event_sound(films(tmp_path, loop(9.0)), keypoints)
    assert np.isnan(heard.start_s).all()
    assert len(heard.notes) == 3
    assert all("their sound repeats itself" in note for note in heard.notes)
    assert with_sound(Hints(), heard.start_s, keypoints) == Hints()


def test_a_silent_film_takes_no_part(tmp_path, keypoints):
    files = films(tmp_path, event(9.0))
    files["v3"] = write_film(tmp_path / "silent.mp4", None, SECONDS)
    heard = event_sound(files, keypoints)
    np.testing.assert_allclose(heard.start_s[:2], STARTS[:2], atol=0.5 / FPS)
    assert np.isnan(heard.start_s[2])
    assert any(note.startswith("v3: no sound") for note in heard.notes)
    assert np.isnan(event_sound({}, keypoints).start_s).all()


def test_anchors_of_the_user_come_first(keypoints):
    user = Anchor(0, 60, 1, 20.0, True)
    hints = with_sound(Hints((user,), ((2, 0, 100),)), np.array(STARTS), keypoints)
    assert [x for x in hints.anchors if {x.a, x.b} == {0, 1}] == [user]
    assert all(x.frame_b > 99.5 for x in hints.anchors if x.b == 2)


def test_sound_is_read_from_the_first_picture_on(tmp_path):
    clicks = np.zeros(2 * RATE)
    clicks[RATE] = 1.0
    samples = read_sound(write_film(tmp_path / "a.mp4", clicks, 2.0), 16_000.0)
    assert samples is not None
    assert abs(np.abs(samples).argmax() / 16_000.0 - 1.0) < 0.005
    assert read_sound(write_film(tmp_path / "b.mp4", None, 1.0), 16_000.0) is None

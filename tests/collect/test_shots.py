"""A film is cut where its shots change, at once or gradually, and nowhere else."""

import numpy as np
import pytest

from imocap_core.collect import shots
from imocap_core.collect.shots import content, find_shots, without_bars
from tests.collect.conftest import faded, mixed, place


@pytest.mark.parametrize("frames", [8, 14, 20])
@pytest.mark.parametrize("kind", ["dissolve", "wipe"])
def test_a_gradual_transition_belongs_to_no_shot(kind: str, frames: int) -> None:
    first, second = find_shots(mixed(place(1, 50), place(2, 60), frames, kind))
    assert first.first == 0
    assert second.stop == 110 - frames
    assert abs(first.stop - (50 - frames)) <= 3
    assert abs(second.first - 50) <= max(3, 0.4 * frames)
    assert first.ends == second.begins == kind


def test_a_fade_through_black_is_one_boundary() -> None:
    first, second = find_shots(faded(place(1, 40), place(2, 40), 10))
    assert (first.ends, second.begins) == ("fade", "fade")
    assert first.stop == pytest.approx(30, abs=2)
    assert second.first == pytest.approx(50, abs=2)


def test_black_frames_are_no_shot() -> None:
    black = [np.zeros((90, 160), np.uint8)] * 9
    parts = find_shots([*place(1, 30), *black, *place(2, 30)])
    assert [(shot.first, shot.stop) for shot in parts] == [(0, 30), (39, 69)]


def test_cuts_are_on_their_frames_behind_letterbox_bars() -> None:
    film = [*place(1, 20), *place(2, 25), *place(3, 20)]
    for picture in film:
        picture[:, :30] = picture[:, -30:] = 4
    parts = find_shots(film)
    assert [(shot.first, shot.begins) for shot in parts] == [(0, "start"), (20, "cut"), (45, "cut")]


@pytest.mark.parametrize("speed", [0.0, 3.0, 9.0])
def test_a_panning_camera_is_one_shot(speed: float) -> None:
    assert len(find_shots(place(4, 60, speed=speed))) == 1


def test_a_flash_is_no_boundary() -> None:
    film = place(5, 50)
    film[20] = film[21] = np.full_like(film[0], 250)
    assert len(find_shots(film)) == 1


def test_who_walks_through_the_picture_is_no_wipe() -> None:
    film = place(6, 60, speed=0.0)
    for t, picture in enumerate(film):
        picture[20:90, 2 * t : 2 * t + 18] = 240
    assert len(find_shots(film)) == 1


def test_a_still_picture_is_still() -> None:
    picture = place(7, 1)[0]
    still, moving = find_shots([*[picture] * 30, *place(8, 30, speed=1.0)])
    assert still.still
    assert not moving.still


def test_a_long_film_is_cut_as_a_short_one(monkeypatch: pytest.MonkeyPatch) -> None:
    black = [np.zeros((90, 160), np.uint8)] * 150
    film = [
        *mixed(place(1, 70), place(2, 90), 12, "dissolve"),
        *faded(place(3, 60), place(4, 50), 15),
        *mixed(place(5, 60), place(6, 40), 20, "wipe"),
        *black,
        *place(7, 40),
    ]
    whole = find_shots(film)
    assert [s.begins for s in whole] == ["start", "dissolve", "cut", "fade", "cut", "wipe", "blank"]
    for chunk in (61, 137):
        monkeypatch.setattr(shots, "CHUNK", chunk)
        assert find_shots(film) == whole


def test_bars_are_what_is_dark_at_the_border() -> None:
    picture = np.zeros((90, 160), np.uint8)
    picture[10:80, 20:140] = place(1, 1)[0][10:80, 20:140]
    rows, columns = content(picture)
    assert (rows.start, rows.stop, columns.start, columns.stop) == (10, 80, 20, 140)
    assert without_bars(picture)[:10].std() == 0
    dark = np.zeros((90, 160), np.uint8)
    assert content(dark) == (slice(0, 90), slice(0, 160))


def test_no_film_has_no_shots() -> None:
    assert find_shots([]) == []

"""The performer that action.yaml declares is the performer."""

import numpy as np
import pytest

from imocap_core.people.performer import (
    FramePlace,
    declared_performer,
    ranked_tracks,
    row_at_place,
    row_of_number,
)

SHAPE = np.random.default_rng(0).uniform(-1, 1, (17, 2)) * [25, 60]


def person(x: float, wave: float = 0.0) -> np.ndarray:
    pose = np.concatenate([[x, 180] + SHAPE, np.full((17, 1), 0.8)], axis=1)
    pose[:4, 1] += wave
    return pose


PEOPLE = [np.stack([person(150, 20 * np.sin(0.3 * t)), person(450)]) for t in range(60)]
RANKED = ranked_tracks(PEOPLE, (640, 360), 30.0, min_confidence=0.05)


def x_of(row: int) -> float:
    return float(np.nanmean(declared_performer(RANKED, row, PEOPLE).xy_px[:, 5:, 0]))


def test_by_number() -> None:
    assert x_of(row_of_number(RANKED, 1)) == pytest.approx(150, abs=20)
    assert x_of(row_of_number(RANKED, 2)) == pytest.approx(450, abs=20)
    with pytest.raises(ValueError, match="track: expected 1 to 2, got 3"):
        row_of_number(RANKED, 3)


@pytest.mark.parametrize(("x", "row"), [(150, 0), (170, 0), (440, 1), (480, 1)])
def test_by_a_point_and_by_a_box(x: float, row: int) -> None:
    assert row_at_place(RANKED, FramePlace(10, point_px=(x, 180))) == row
    assert row_at_place(RANKED, FramePlace(10, box_px=(x - 30, 100, x + 30, 260))) == row


@pytest.mark.parametrize(
    "place",
    [
        FramePlace(10, point_px=(640, 20)),
        FramePlace(10, box_px=(0, 0, 20, 20)),
        FramePlace(99, (150, 180)),
    ],
)
def test_an_error_lists_who_is_in_the_frame(place: FramePlace) -> None:
    with pytest.raises(ValueError, match=r"got nobody; in that frame there are: (track 1 at|none)"):
        row_at_place(RANKED, place)


def test_the_note_names_the_declaration() -> None:
    assert "as action.yaml declares" in declared_performer(RANKED, 1, PEOPLE).note

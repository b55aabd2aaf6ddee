"""Compilations are cut as their pieces say, and lists of what is collected are counted rightly."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks import collect_edit
from imocap_core.collect.listing import ListedShot
from imocap_core.collect.shots import find_shots
from imocap_core.io.video import read_gray, write_h264


@pytest.fixture(scope="module")
def takes(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    files = []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        texture = (255 * cv2.resize(rng.random((9, 12, 3)), (240, 180))).astype(np.uint8)
        files.append(tmp_path_factory.mktemp("takes") / f"{seed}.mp4")
        write_h264(files[-1], [np.roll(texture, t, axis=1) for t in range(50)], 30.0)
    return files


@pytest.fixture(scope="module")
def film(takes, tmp_path_factory):
    a, b, c = takes
    pieces = [
        collect_edit.Piece(a, shown="serve/a"),
        collect_edit.Piece(b, "dissolve", 10, shown="kick/b", letterbox=True),
        collect_edit.Piece(None, length=8),
        collect_edit.Piece(a, span=(0, 10), repeat=4, shown="serve/a", caption="REPLAY"),
        collect_edit.Piece(c, "fade", 8, step=2),
    ]
    file = tmp_path_factory.mktemp("film") / "film.mp4"
    return file, collect_edit.write_film(file, pieces)


def test_the_pieces_are_where_the_editor_says(
    film: tuple[Path, list[collect_edit.CutPiece]],
) -> None:
    file, places = film
    assert [(p.first, p.stop, p.source_first) for p in places] == [
        (0, 40, 0),
        (50, 90, 10),
        (90, 98, 0),
        (98, 130, 0),
        (146, 163, 8),
    ]
    pictures = [picture for _, picture in read_gray(file)]
    assert pictures[0].shape == collect_edit.SIZE[::-1]
    assert len(pictures) == 163
    assert pictures[93].max() < 24
    assert np.abs(pictures[100].astype(float) - pictures[99]).mean() < 1.0  # shown again


def test_its_shots_are_found(film: tuple[Path, list[collect_edit.CutPiece]]) -> None:
    file, places = film
    truth = collect_edit.true_boundaries(places)
    assert [kind for _, _, kind in truth] == ["dissolve", "black", "fade"]
    found = find_shots(picture for _, picture in read_gray(file, scale=0.25))
    assert collect_edit.boundary_tally(
        [_listed(s.first, s.stop) for s in found], truth
    ) == collect_edit.Tally(3, 3, 0)


def test_missed_and_false_boundaries_are_counted() -> None:
    truth = [(40, 50, "dissolve"), (90, 90, "cut"), (120, 120, "cut")]
    shots = [_listed(0, 41), _listed(49, 70), _listed(70, 92), _listed(92, 150)]
    tally = collect_edit.boundary_tally(shots, truth)
    assert tally == collect_edit.Tally(3, 2, 1)
    assert tally.recall == pytest.approx(2 / 3)
    assert tally.precision == pytest.approx(2 / 3)


def _listed(first: int, stop: int) -> ListedShot:
    return ListedShot(
        number=1, frames=(first, stop), seconds=(0, 1), begins="cut", ends="cut", people=0,
        outcome="",
    )  # fmt: skip

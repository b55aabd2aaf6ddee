"""Cuts are found where the film goes on elsewhere, and nowhere else."""

import cv2
import numpy as np
import pytest

from imocap_core.people.shot_boundaries import Agreement, best_correlation, find_cuts, thumbnail


def place(seed: int) -> np.ndarray:
    """A wide grey picture (200, 900) with large and small structures."""
    rng = np.random.default_rng(seed)
    layers = [cv2.resize(rng.random((n, 4 * n)), (900, 200)) for n in (3, 8, 30)]
    return (255 * np.clip(sum(layers) / 3, 0, 1)).astype(np.uint8)


def shot(seed: int, frames: int, speed: float = 2.0) -> list[np.ndarray]:
    """A camera that pans over a place, with noise."""
    rng = np.random.default_rng(seed)
    wide = place(seed).astype(float)
    starts = [round(speed * t) for t in range(frames)]
    return [
        np.clip(wide[:, s : s + 320] + rng.normal(0, 6, (200, 320)), 0, 255).astype(np.uint8)
        for s in starts
    ]


@pytest.mark.parametrize("cut", [1, 2, 15, 29])
def test_a_cut_is_found_on_its_frame(cut: int) -> None:
    assert find_cuts(shot(1, cut) + shot(2, 30 - cut)) == [cut]


def test_several_cuts_and_a_film_run_backwards() -> None:
    film = shot(1, 10) + shot(2, 12) + shot(3, 8) + shot(1, 9)
    assert find_cuts(film) == [10, 22, 30]
    assert find_cuts(film[::-1]) == sorted(len(film) - c for c in (10, 22, 30))


@pytest.mark.parametrize("speed", [0.0, 5.0, 20.0])
def test_a_panning_camera_is_one_shot(speed: float) -> None:
    assert find_cuts(shot(4, 25, speed)) == []


def test_a_fast_sweep_is_one_shot() -> None:
    assert find_cuts(shot(4, 5) + shot(4, 6, 90.0) + shot(4, 5)[::-1]) == []


def test_a_flash_and_a_change_of_light_are_no_cut() -> None:
    film = shot(5, 20)
    flash = [*film[:10], np.full_like(film[0], 250), *film[11:]]
    assert find_cuts(flash) == []
    darker = [*film[:10], *[(0.5 * x).astype(np.uint8) for x in film[10:]]]
    assert find_cuts(darker) == []


def test_blank_and_short_films() -> None:
    blank = np.zeros((90, 160), np.uint8)
    assert find_cuts([]) == find_cuts([blank]) == find_cuts([blank] * 4) == []
    assert best_correlation(thumbnail(blank), thumbnail(blank)) == 1.0


RNG = np.random.default_rng(0)
SCENE = RNG.integers(0, 255, (60, 80), dtype=np.uint8).repeat(4, 0).repeat(4, 1)
POINTS = RNG.uniform((60, 60), (240, 180), (30, 2))


def test_points_that_move_with_the_picture_those_that_do_not_and_still_ones() -> None:
    agreement = Agreement(4)
    for dx, dy in ((3, 0), (-2, 4), (0, -5)):
        after = np.roll(SCENE, (dy, dx), axis=(0, 1))
        moved, across = POINTS + (dx, dy), POINTS + (dy, -dx)
        nobody = np.zeros((0, 2))
        rows = [(POINTS, moved), (POINTS, across), (POINTS, POINTS), (nobody, nobody)]
        agreement.add(SCENE, after, rows)
    right, wrong, still, none = agreement.values()
    assert right > 0.95
    assert abs(wrong) < 0.1
    assert np.isnan(still)
    assert np.isnan(none)


def test_points_outside_the_picture_agree_with_nothing() -> None:
    agreement = Agreement(1)
    agreement.add(SCENE, np.roll(SCENE, 3, axis=1), [(POINTS + 1000.0, POINTS + (1003.0, 1000.0))])
    assert agreement.values() == [0.0]

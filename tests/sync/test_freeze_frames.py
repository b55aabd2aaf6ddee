"""Freeze frames: one picture, one moment, one observation; a person who stands still is none."""

import numpy as np
import pytest

from imocap_core.sync import Anchor, Hints
from imocap_core.sync.freeze_frames import distinct_frames, frozen_runs, hints_of_pictures
from tests.sync.test_synchronise import FPS, error_s, estimated, run

PHASE = np.linspace(0.5, 4.5, 120)
BEGIN, LENGTH = 60, 30


def frozen(values: np.ndarray, begin: int = BEGIN, length: int = LENGTH) -> np.ndarray:
    """The frames of a video that shows frame `begin` for `length` frames."""
    again = np.repeat(values[begin : begin + 1], length - 1, axis=0)
    return np.concatenate([values[: begin + 1], again, values[begin + 1 :]])


def test_runs_are_found_where_nothing_moves() -> None:
    poses = estimated(PHASE, np.random.default_rng(1))
    visible = np.ones(poses.shape[:2], dtype=bool)
    assert frozen_runs(poses, visible, FPS) == []
    held = frozen(poses)
    runs = frozen_runs(held, np.ones(held.shape[:2], dtype=bool), FPS)
    assert runs == [(BEGIN, BEGIN + LENGTH - 1)]


@pytest.mark.parametrize("jitter_m", [0.001, 0.01])
def test_a_person_who_stands_still_is_no_freeze_frame(jitter_m: float) -> None:
    rng = np.random.default_rng(2)
    still = frozen(estimated(PHASE, rng))
    still[BEGIN : BEGIN + LENGTH] += jitter_m * rng.normal(size=(LENGTH, 12, 3))
    assert frozen_runs(still, np.ones(still.shape[:2], dtype=bool), FPS) == []


def test_undetected_and_twice_shown_frames_are_none() -> None:
    poses = estimated(PHASE, np.random.default_rng(3))
    missing = poses.copy()
    missing[40:80] = np.nan
    visible = np.isfinite(missing).all(-1)
    assert frozen_runs(missing, visible, FPS) == []
    twice = np.repeat(poses, 2, axis=0)
    assert frozen_runs(twice, np.ones(twice.shape[:2], dtype=bool), 2 * FPS) == []


def test_positions_lead_to_the_frames_of_the_pictures_and_back() -> None:
    pictures = distinct_frames([(3, 6), (9, 11)], 12)
    assert pictures.runs == [(3, 6), (9, 11)]
    assert pictures.times_shown.tolist() == [1, 1, 1, 4, 4, 4, 4, 1, 1, 3, 3, 3]
    positions = np.array([0.5, 3.0, 3.5, 4.0, 6.0, np.nan])
    np.testing.assert_array_equal(pictures.in_frames(positions), [0.5, 3.0, 6.5, 7.0, 9.0, np.nan])
    every = pictures.in_frames(pictures.picture.astype(float))
    assert (pictures.picture[every.astype(int)] == pictures.picture).all()


@pytest.mark.long
def test_a_freeze_frame_has_one_moment_and_the_rest_is_as_without_it() -> None:
    rng = np.random.default_rng(4)
    other, poses = estimated(np.linspace(0.4, 4.6, 126), rng), estimated(PHASE, rng)
    plain = run([other, poses], reference=0)
    result = run([other, frozen(poses)], reference=0)
    expected = frozen(plain.reference_frame[1])
    np.testing.assert_allclose(result.reference_frame[1], expected)
    np.testing.assert_allclose(result.phase[1], frozen(plain.phase[1]))
    held = slice(BEGIN, BEGIN + LENGTH)
    assert np.ptp(result.reference_frame[1][held]) == 0.0
    # together they are one observation
    assert result.confidence[1][held].sum() == pytest.approx(plain.confidence[1][BEGIN])
    assert result.relaxed.pair(0, 1).shape == (126, 149)
    assert result.affinity.pairs[0, 1].shape == (126, 149)


@pytest.mark.long
@pytest.mark.parametrize("reference", [None, 1])
def test_a_held_last_frame_and_a_frozen_reference(reference: int | None) -> None:
    rng = np.random.default_rng(5)
    phases = [np.linspace(0.4, 4.6, 126), frozen(PHASE, 119), np.linspace(0.5, 4.4, 110)]
    poses = [estimated(phases[0], rng), frozen(estimated(PHASE, rng), 119), None]
    poses[2] = estimated(phases[2], rng)
    result = run(poses, reference=reference)
    if reference is None:
        assert result.reference != 1  # while another video can be
        assert np.ptp(result.reference_frame[1][119:]) == 0.0
    else:
        np.testing.assert_array_equal(result.reference_frame[1], np.arange(149.0))
    assert error_s(phases, result.reference_frame, result.reference).mean() < 0.04


def test_hints_are_those_of_the_pictures() -> None:
    pictures = [distinct_frames([(3, 6)], 12), distinct_frames([], 10)]
    hints = Hints((Anchor(0, 5, 1, 2.5), Anchor(0, 8, 1, 6.0)), ((0, 4, 9), (1, 2, 4)))
    moved = hints_of_pictures(hints, pictures)
    assert [(a.frame_a, a.frame_b) for a in moved.anchors] == [(3, 2.5), (5, 6.0)]
    assert moved.forbidden == ((0, 3, 6), (1, 2, 4))

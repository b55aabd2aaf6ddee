"""A map that fits a repetition later nearly as well, and motions that do not repeat."""

import numpy as np

from imocap_core.sync.confidence import DISTINCT, next_repetition, repeats

FPS = 30.0
FRAMES = np.arange(120.0)


def squares(theirs: np.ndarray, mine: np.ndarray, noise: float = 0.05) -> np.ndarray:
    return np.asarray(((mine[:, None] - theirs[None]) ** 2).sum(-1) + noise)


def cycle(period: float) -> np.ndarray:
    angle = 2 * np.pi * FRAMES / period
    return np.column_stack([np.cos(angle), np.sin(angle)])


def evidence(points: np.ndarray, positions: np.ndarray = FRAMES) -> float:
    matched = np.isfinite(positions)
    best = next_repetition(squares(points, points), np.nan_to_num(positions), matched, FPS)
    return 0.0 if best is None else best.evidence


def test_a_cycle_fits_a_period_later_as_well() -> None:
    np.testing.assert_allclose(evidence(cycle(30.0)), np.log(DISTINCT), atol=1e-6)


def test_the_shift_is_a_period() -> None:
    points = np.column_stack([cycle(40.0), 0.004 * FRAMES])
    best = next_repetition(squares(points, points), FRAMES, np.ones(120, dtype=bool), FPS)
    assert best is not None
    assert abs(best.shift_frames) == 40.0


def test_a_path_and_a_stand_repeat_nothing() -> None:
    path = np.column_stack([0.1 * FRAMES, np.zeros(120)])
    assert evidence(path) == 0.0
    assert evidence(np.zeros((120, 2))) == 0.0
    assert evidence(np.concatenate([np.zeros((60, 2)), path[:60]])) == 0.0


def test_a_cycle_that_drifts_fits_less_well_later() -> None:
    drifting = np.column_stack([cycle(30.0), 0.004 * FRAMES])
    assert 0 < evidence(drifting) < np.log(DISTINCT)


def test_a_repetition_that_the_clip_does_not_show_twice_is_none() -> None:
    assert evidence(cycle(80.0)) == 0.0


def test_nothing_matched_and_nothing_known() -> None:
    assert evidence(cycle(30.0), np.full(120, np.nan)) == 0.0
    unknown = np.full((120, 120), np.nan)
    assert next_repetition(unknown, FRAMES, np.ones(120, dtype=bool), FPS) is None


def test_only_what_a_video_shows_twice_repeats() -> None:
    points = cycle(40.0)
    assert repeats(squares(points, points, 0.05), 41.0, 3.0)
    assert not repeats(squares(points, points, 0.05), 25.0, 3.0)
    once = np.concatenate([np.zeros((40, 2)), points[:40] - points[0], np.zeros((40, 2))])
    for period in range(10, 61, 5):  # a movement with a rest before and after it
        assert not repeats(squares(once, once), period, 3.0)
    assert not repeats(squares(points[:70], points[:70]), 40.0, 3.0)  # less than two cycles
    assert not repeats(np.full((50, 50), np.nan), 10.0, 2.0)

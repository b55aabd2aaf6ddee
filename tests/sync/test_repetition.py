"""Repetitions: their number is exact, their cuts are near the true ones, none where none are."""

import os
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from imocap_core.sync.repetition import (
    Repetitions,
    best_totals,
    chosen_spans,
    find_picture_repetitions,
    find_repetitions,
    match_values,
    subsequence_dtw,
)
from imocap_core.synthetic.choreography import PhaseSpan, pace

Array = NDArray[np.float64]
LONG = pytest.mark.long

FPS = 30.0
JOINTS = 14


def _wandering(frames: int, rng: np.random.Generator, reach_m: float = 0.2) -> Array:
    """(frames, J, 3): joints that move smoothly about a fixed skeleton and never come back."""
    white = rng.normal(size=(frames + 60, JOINTS, 3))
    smooth = gaussian_filter1d(white, 8.0, axis=0)[30:-30]
    return rng.normal(size=(1, JOINTS, 3)) * 0.4 + reach_m * smooth / smooth.std()


def _from_rest_to_rest(frames: int, rng: np.random.Generator) -> Array:
    """An action that begins and ends in one stance."""
    action = _wandering(frames, rng)
    rest = action.mean(axis=0)
    share = np.minimum(1.0, np.sin(np.linspace(0, np.pi, frames)) * 2.0)[:, None, None]
    return rest + share * (action - rest)


def _repeated(
    action: Array, count: int, pause_s: float, rng: np.random.Generator
) -> tuple[Array, list[tuple[int, int]]]:
    """Performances of one action, each at its own pace and a little different, with pauses."""
    parts: list[Array] = []
    spans, frames = [], 0
    for _ in range(count):
        length = round(len(action) * rng.uniform(0.75, 1.35))
        phase = pace(PhaseSpan(length, 0.0, len(action) - 1.0, FPS), rng)
        low = np.minimum(phase.astype(int), len(action) - 2)
        share = (phase - low)[:, None, None]
        part = (1 - share) * action[low] + share * action[low + 1]
        part = part + 0.02 * rng.normal(size=(1, JOINTS, 3))
        if parts:
            hold = round(rng.uniform(0.6, 1.6) * pause_s * FPS)
            ease = np.linspace(0, 1, hold)[:, None, None]
            parts.append((1 - ease) * parts[-1][-1] + ease * part[0])
            frames += hold
        parts.append(part)
        spans.append((frames, frames + length))
        frames += length
    return np.concatenate(parts), spans


def _unsure(poses: Array, rng: np.random.Generator, sigma_m: float = 0.02) -> Array:
    """Slow errors, as a monocular estimate has."""
    slow = gaussian_filter1d(rng.normal(size=poses.shape), 7.0, axis=0)
    return poses + sigma_m * slow / slow.std()


def _find(poses: Array) -> Repetitions:
    return find_repetitions(poses, FPS)


@pytest.mark.parametrize(
    ("count", "pause_s"),
    [(2, 0.0), pytest.param(2, 1.0, marks=LONG), (3, 1.0), pytest.param(5, 0.0, marks=LONG)],
)
def test_number_is_exact_and_cuts_are_near(count: int, pause_s: float) -> None:
    for seed in range(2):
        rng = np.random.default_rng([seed, count])
        poses, spans = _repeated(_from_rest_to_rest(75, rng), count, pause_s, rng)
        repetitions = _find(_unsure(poses, rng))
        assert len(repetitions.spans) == count, repetitions.status
        off = np.array(repetitions.spans) - np.array(spans)
        common = np.median(off, axis=0)  # the same share of the slow beginning and end left out
        assert np.abs(common).max() <= 15, off
        assert np.abs(off - common).max() <= 10, off


def test_a_periodic_motion_is_cut_at_one_phase() -> None:
    """Without a beginning, any phase will do, but the same one in every cycle."""
    rng = np.random.default_rng(3)
    cycle = _wandering(40, rng)
    cycle = gaussian_filter1d(cycle, 3.0, axis=0, mode="wrap")
    phase = pace(PhaseSpan(200, 0.0, 5.6 * 40, FPS), rng)
    low = phase.astype(int)
    share = (phase - low)[:, None, None]
    poses = (1 - share) * cycle[low % 40] + share * cycle[(low + 1) % 40]
    repetitions = _find(_unsure(poses, rng, 0.01))
    assert len(repetitions.spans) in (5, 6)
    cuts = phase[[first for first, _ in repetitions.spans]] / 40
    spread = np.abs(np.exp(2j * np.pi * cuts).mean())
    assert spread > 0.95
    lengths = np.diff(phase[[[a, b - 1] for a, b in repetitions.spans]], axis=1) / 40
    assert np.abs(lengths[1:-1] - 1).max() < 0.1


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=LONG) for seed in (1, 2))])
def test_a_clip_without_repetition_is_left_whole(seed: int) -> None:
    rng = np.random.default_rng(seed)
    repetitions = _find(_unsure(_wandering(300, rng), rng))
    assert repetitions.spans == ((0, 300),)
    assert repetitions.status.startswith("no repetitions")


def test_other_motion_between_repetitions_belongs_to_none() -> None:
    rng = np.random.default_rng(5)
    poses, spans = _repeated(_from_rest_to_rest(75, rng), 3, 0.0, rng)
    other = poses[:1] + (_wandering(60, rng) - _wandering(1, rng)) * 0.5
    cut = spans[1][0]
    repetitions = _find(np.concatenate([poses[:cut], other, poses[cut:]]))
    assert len(repetitions.spans) == 3
    assert all(b <= cut + 8 or a >= cut + 52 for a, b in repetitions.spans)


def test_view_size_and_still_ends_change_nothing() -> None:
    rng = np.random.default_rng(6)
    poses, _ = _repeated(_from_rest_to_rest(75, rng), 2, 0.5, rng)
    repetitions = _find(poses)
    assert len(repetitions.spans) == 2
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    assert _find(2.5 * poses @ turn.T + [3.0, -1.0, 7.0]).spans == repetitions.spans
    waiting = np.concatenate([np.repeat(poses[:1], 40, axis=0), poses])
    later = np.array(_find(waiting).spans) - 40
    assert np.abs(later - np.array(repetitions.spans)).max() <= 6


def test_errors_in_depth_do_not_hide_what_repeats_in_the_picture() -> None:
    rng = np.random.default_rng(5)
    poses, spans = _repeated(_from_rest_to_rest(75, rng), 3, 0.5, rng)
    wrong = _unsure(poses[..., 2], rng, 0.4)
    assert len(_find(np.concatenate([poses[..., :2], wrong[..., None]], axis=-1)).spans) == 1
    unsure = rng.random(poses.shape[:2]) < 0.1
    xy_px = 200 * poses[..., :2] + 300 * unsure[..., None]
    assert len(find_picture_repetitions(xy_px, 0.9 - 0.8 * unsure, FPS).spans) == len(spans)


def test_a_still_or_short_clip_is_one_piece() -> None:
    assert _find(np.ones((100, 5, 3))).spans == ((0, 100),)
    assert _find(_wandering(8, np.random.default_rng(0))).spans == ((0, 8),)
    assert _find(np.full((50, 5, 3), np.nan)).spans == ((0, 50),)


def _best_warp_naive(similarity: Array, e: int) -> float:
    """Every warp of all the template's samples that ends at e, one by one."""
    best = -np.inf
    n = len(similarity)

    def go(k: int, sample: int, total: float) -> None:
        nonlocal best
        if k == 0:
            best = max(best, total)
            return
        for step in (1, 2):
            if sample >= step:
                go(k - 1, sample - step, total + similarity[k - 1, sample - step])
        if k >= 2 and sample >= 1:
            go(k - 2, sample - 1, total + similarity[k - 1, sample] + similarity[k - 2, sample - 1])

    go(n - 1, e, similarity[n - 1, e])
    return best


def test_subsequence_dtw_equals_all_warps_tried_one_by_one() -> None:
    similarity = np.random.default_rng(8).uniform(-1, 1, size=(5, 9))
    total, begin = subsequence_dtw(similarity)
    for n in range(1, 6):
        naive = [_best_warp_naive(similarity[:n], e) for e in range(9)]
        # a step of two template samples counts the skipped one where the warp goes on
        np.testing.assert_allclose(total[n - 1], naive)
    assert (begin <= np.arange(9)).all()


def test_chosen_matches_do_not_overlap_and_no_choice_is_better() -> None:
    rng = np.random.default_rng(9)
    total, begin = subsequence_dtw(rng.uniform(-0.6, 1, size=(3, 12)))
    value = match_values(total[-1:], begin[-1:], np.array([3]), 0, 0.2)
    best = best_totals(value, begin[-1:])[0]
    spans = chosen_spans(best, begin[-1])
    assert all(a[1] <= b[0] for a, b in pairwise(spans))
    assert sum(value[0, b - 1] for _, b in spans) == pytest.approx(best[-1])
    every = [(int(begin[-1, e]), e + 1, value[0, e]) for e in range(12) if value[0, e] > 0]

    def most(after: int) -> float:
        return max((v + most(b) for a, b, v in every if a >= after), default=0.0)

    assert best[-1] == pytest.approx(most(0))


DATA = Path(os.environ.get("IMOCAP_DATA", Path(__file__).parents[3] / "shared" / "data"))
FILE = DATA / "train" / "cmu_train.npz"

captured = pytest.mark.skipif(not FILE.is_file(), reason="needs the training clips (IMOCAP_DATA)")


def _clip(name: str) -> np.ndarray:
    with np.load(FILE) as stored:
        joints = stored[f"clip_{name}"].astype(np.float64)
    relative: np.ndarray = joints - joints[:, :1]
    return relative


@captured
@pytest.mark.parametrize(("walk", "strides"), [("06_01", 3), ("12_02", 4), ("12_03", 3)])
def test_strides_of_a_walk_are_counted(walk: str, strides: int) -> None:
    assert len(_find(_clip(walk)).spans) == strides


@captured
@pytest.mark.parametrize(
    "dance", ["05_04", *(pytest.param(dance, marks=LONG) for dance in ("05_13", "13_15"))]
)
def test_nothing_repeats_in_a_dance(dance: str) -> None:
    assert len(_find(_clip(dance)).spans) == 1


@captured
@pytest.mark.parametrize("action", ["05_03", pytest.param("06_14", marks=LONG)])
def test_performances_in_a_row_are_counted_and_cut(action: str) -> None:
    rng = np.random.default_rng(int(action[-2:]))
    once = _clip(action)
    parts, phases = [], []
    for _ in range(3):
        length = round(len(once) * rng.uniform(0.75, 1.35))
        phase = pace(PhaseSpan(length, 0.0, len(once) - 1.0, FPS), rng)
        low = np.minimum(phase.astype(int), len(once) - 2)
        share = (phase - low)[:, None, None]
        parts.append((1 - share) * once[low] + share * once[low + 1])
        phases.append(phase / (len(once) - 1))
    repetitions = _find(np.concatenate(parts))
    assert len(repetitions.spans) == 3, repetitions.status
    phase_of = np.concatenate([phase + k for k, phase in enumerate(phases)])
    cuts = np.array([(phase_of[first], phase_of[stop - 1]) for first, stop in repetitions.spans])
    off = cuts - np.arange(3)[:, None]  # in performances; slow endings are trimmed
    assert np.abs(off[:, 0]).max() < 0.2, off
    assert (off[:, 1] > 0.6).all(), off
    assert (off[:, 1] < 1.2).all(), off

"""The sync benchmark: scores of known maps; the TCC baseline: its loss against a slow twin, and
made clips that it must align."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from benchmarks import sync
from benchmarks.ablation_variants import tcc_sync
from benchmarks.sync_scenes import SyncScene
from benchmarks.tcc import LEAST_VARIANCE, POSES, align_by_tcc, cycle_back_regression, pose_clip
from imocap_core.artifacts.schemas import Keypoints, VideoKeypoints
from tests.made_keypoints import made_keypoints

HIPS = [0, 1]
FPS = 30.0
SECONDS = 4.0


def slow_loss(
    u: np.ndarray, v: np.ndarray, times: np.ndarray, temperature: float, weight: float
) -> float:
    """The equations of the paper, one frame and one sum at a time."""

    def softmax(similarities: list[float]) -> list[float]:
        top = max(similarities)
        parts = [math.exp(s - top) for s in similarities]
        return [part / sum(parts) for part in parts]

    def similarity(a: np.ndarray, b: np.ndarray) -> float:
        return -sum((x - y) ** 2 for x, y in zip(a, b, strict=True)) / (len(a) * temperature)

    losses = []
    for i, ui in enumerate(u):
        alpha = softmax([similarity(ui, vj) for vj in v])
        neighbour = sum(a * vj for a, vj in zip(alpha, v, strict=True))
        beta = softmax([similarity(neighbour, uk) for uk in u])
        mean = sum(b * t for b, t in zip(beta, times, strict=True))
        variance = sum(b * (t - mean) ** 2 for b, t in zip(beta, times, strict=True))
        variance = max(variance, LEAST_VARIANCE)
        losses.append((times[i] - mean) ** 2 / variance + weight * math.log(math.sqrt(variance)))
    return sum(losses) / len(losses)


def test_the_loss_of_a_batch_is_the_mean_of_the_slow_ones() -> None:
    rng = np.random.default_rng(0)
    u, v = rng.normal(size=(3, 7, 4)), rng.normal(size=(3, 5, 4))
    times = np.sort(rng.uniform(size=(3, 7)), axis=1)
    tensors = [torch.as_tensor(x) for x in (u, v, times)]
    fast = cycle_back_regression(*tensors, temperature=0.5, variance_weight=0.1)
    slow = [slow_loss(*pair, 0.5, 0.1) for pair in zip(u, v, times, strict=True)]
    assert float(fast) == pytest.approx(np.mean(slow), rel=1e-10)


def made_pose(phase: np.ndarray) -> np.ndarray:
    """Pixels (T, 12, 2) of a smooth motion that never returns to a pose; phase in seconds."""
    rng = np.random.default_rng(3)
    rest, swing = rng.normal(size=(12, 2)), 0.5 * rng.normal(size=(5, 12, 2))
    rates = rng.uniform(0.5, 2.0, 5)
    waves = (
        s * np.sin(r * phase + k)[:, None, None]
        for k, (s, r) in enumerate(zip(swing, rates, strict=True))
    )
    return np.asarray(300 + 60 * (rest + sum(waves)))


def error_pct(phases: list[np.ndarray], estimated: list[np.ndarray]) -> float:
    """Mean |estimated - true phase| of the others, in per cent of the motion; video 0 is the
    reference."""
    frames = np.arange(len(phases[0]))
    errors = [
        np.abs(np.interp(e, frames, phases[0]) - p) for e, p in zip(estimated, phases, strict=True)
    ]
    return float(100 * np.nanmean(np.concatenate(errors[1:])) / SECONDS)


def test_one_motion_in_three_timings_is_aligned() -> None:
    rng = np.random.default_rng(1)
    u, w = np.linspace(0, 1, 100), np.linspace(0, 1, 120)
    phases = [
        np.linspace(0, SECONDS, 110),
        SECONDS * u**1.3,
        SECONDS * (w + 0.08 * np.sin(2 * np.pi * w)),
    ]
    clips = [
        pose_clip(
            scale * (made_pose(p) + rng.normal(size=(len(p), 12, 2))) + rng.normal(size=2),
            np.ones((len(p), 12)),
            HIPS,
        )
        for p, scale in zip(phases, (1.0, 0.6, 1.7), strict=True)
    ]
    alignment = align_by_tcc(
        clips, [FPS] * 3, replace(POSES, steps=100, sampled=32), reference=0, seed=0
    )
    assert np.mean(alignment.losses[-5:]) < 0.8 * alignment.losses[0]
    assert error_pct(phases, alignment.reference_frame) < 2.0
    np.testing.assert_array_equal(alignment.reference_frame[0], np.arange(110.0))
    for frame, trust in zip(alignment.reference_frame, alignment.confidence, strict=True):
        assert np.isfinite(frame).mean() > 0.95
        assert (np.diff(frame[np.isfinite(frame)]) >= 0).all()
        assert ((trust >= 0) & (trust <= 1)).all()


def test_a_pose_clip_knows_neither_place_nor_size_and_nothing_of_what_is_missing() -> None:
    xy, confidence = made_pose(np.linspace(0, 2, 20)), np.ones((20, 12))
    xy[3, 5] = np.nan
    confidence[4, 7] = 0.0
    xy[6, :2] = np.nan  # both hips: bridged from the frames beside it
    clip = pose_clip(xy, confidence, HIPS)
    other = pose_clip(0.3 * xy + [70, 900], confidence, HIPS)
    np.testing.assert_allclose(clip, other, atol=1e-5)
    assert np.isfinite(clip).all()
    np.testing.assert_array_equal(clip[[3, 4], [5, 7]], 0.0)
    np.testing.assert_allclose(clip[0, :2, :2].sum(axis=0), 0.0, atol=1e-5)


def swinging_video(name: str, count: int) -> VideoKeypoints:
    """A performer who swings about; ten frames of the file are not used."""
    turn = np.linspace(0, 2, count)[:, None]
    points = np.arange(25)[None]
    xy = np.stack([48 + 12 * np.sin(turn + points), 32 + 12 * np.cos(1.5 * turn + points)], -1)
    box = np.concatenate([xy.min(axis=1), xy.max(axis=1)], axis=1)
    return made_keypoints(
        np.arange(10, 10 + count), id=name, size=(96, 64), xy_px=xy,
        confidence=np.ones((count, 25)), person_box_px=box,
    )  # fmt: skip


def test_every_frame_of_every_video_is_placed() -> None:
    keypoints = Keypoints(videos=[swinging_video("a", 24), swinging_video("b", 30)])
    sync = tcc_sync(keypoints, reference="b", seed=0, settings=replace(POSES, steps=3, sampled=8))
    assert sync.lengths == [24, 30]
    np.testing.assert_array_equal(sync.maps[1].reference_frame, np.arange(30.0))
    placed = sync.maps[0].reference_frame
    assert placed.min() >= 0
    assert placed.max() <= 29
    assert (np.diff(placed) >= 0).all()


def scene() -> SyncScene:
    """Two videos of 101 phases; the second starts 5 later."""
    phases = [np.arange(101.0), np.arange(5.0, 95.0)]
    poses = [np.zeros((len(p), 14, 3)) for p in phases]
    return SyncScene("made", poses, phases, [30.0, 30.0], 100.0, events=[50, 45])


def test_true_maps_score_zero_and_shifted_ones_their_shift() -> None:
    made = scene()
    reference_map, true = np.arange(101.0), np.arange(90.0) + 5.0
    assert sync.score_maps(made, 0, [reference_map, true]).error_pct == 0.0
    shifted = sync.score_maps(
        made, 0, [reference_map, true + 2.0], [np.ones(101), np.full(90, 0.5)]
    )
    assert shifted.error_pct == pytest.approx(2.0)
    assert shifted.within_one == 0.0
    assert shifted.confidence == 0.5
    assert sync.pair_error_pct(made, 1, 0, true - 1.0) == pytest.approx(1.0)


def test_an_unmatched_event_is_infinitely_far() -> None:
    made = scene()
    estimate = np.arange(90.0) + 6.0
    assert sync.event_errors_frames(made, 0, [np.arange(101.0), estimate]) == pytest.approx([1.0])
    estimate[45] = np.nan
    assert np.isinf(sync.event_errors_frames(made, 0, [np.arange(101.0), estimate])).all()


def test_the_confidence_is_held_against_the_errors() -> None:
    made = scene()
    reference_map, true = np.arange(101.0), np.arange(90.0) + 5.0
    estimate = true.copy()
    estimate[:45] += 6.0  # 0.2 s off
    trust = np.where(np.arange(90) < 45, 0.3, 0.95)
    estimate[80:] = np.nan
    pairs = sync.confidences_and_errors(made, 0, [reference_map, estimate], [np.ones(101), trust])
    assert len(pairs) == 80
    rows = {r.confidence: r for r in sync.calibration(pairs, 0.1)}
    assert list(rows) == ["0.2 to 0.4", "0.9 to 1.0", "0.0 to 1.0"]
    assert (rows["0.2 to 0.4"].within, rows["0.9 to 1.0"].within) == (0.0, 1.0)
    assert rows["0.2 to 0.4"].median_s == pytest.approx(0.2)
    assert rows["0.0 to 1.0"].frames == 80
    assert rows["0.0 to 1.0"].within == pytest.approx(35 / 80)


def test_rivals_answer_in_the_reference() -> None:
    rng = np.random.default_rng(0)
    phases = [np.linspace(0.0, 1.0, n) for n in (40, 30)]
    way = rng.normal(size=(14, 3))
    rest = rng.normal(size=(14, 3))
    poses = [rest + np.sin(5 * p)[:, None, None] * way for p in phases]
    made = SyncScene("made", poses, [100 * p for p in phases], [30.0, 25.0], 100.0)
    frames, _ = sync.rival("stretch", made, 0)
    np.testing.assert_allclose(frames[1], np.linspace(0.0, 39.0, 30))
    few = replace(POSES, steps=5)
    frames, trust = sync.rival("tcc", made, 0, tcc=few)
    np.testing.assert_array_equal(frames[0], np.arange(40.0))
    assert len(frames[1]) == len(trust[1]) == 30
    assert np.nanmax(frames[1]) <= 39.0
    with pytest.raises(ValueError, match="expected one of tcc, stretch"):
        sync.rival("guess", made, 0)

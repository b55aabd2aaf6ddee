"""Synchronisation by reprojection: given motion, cameras and size of the noise; of several
hypotheses for a video pictures decide."""

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest

from imocap_core.sync import SyncEvidence, synchronise
from imocap_core.sync.axes import increasing
from imocap_core.sync.hypotheses import (
    CandidateMotions,
    JointChoice,
    best_labellings,
    choose_jointly,
    energy_of,
    pair_costs,
    sentences,
)
from imocap_core.sync.maps import BandedMap, blocks_of_frames
from imocap_core.sync.warp import template as offset_squares
from imocap_core.sync.warp.reprojection_evidence import (
    CalibratedVideo,
    ReprojectionEvidence,
    projected,
    reprojection_squares,
    weights_and_precision,
)
from tests.sync.made_motions import filmed, view_of, wandering
from tests.sync.test_synchronise import PARAMS

K = np.array([[900.0, 0, 500], [0, 900, 500], [0, 0, 1]])
NOISE_PX = 3.0
POINTS = 14


def motion(phase: np.ndarray) -> np.ndarray:
    """(T, 14, 3) smooth swings of a body of 1.8 m, 4 m before the camera."""
    rng = np.random.default_rng(0)
    base = rng.uniform([-0.4, -0.9, 3.8], [0.4, 0.9, 4.2], (POINTS, 3))
    sway, pace, begin = (rng.normal(size=(POINTS, 3)) for _ in range(3))
    return base + 0.25 * sway * np.sin(
        phase[:, None, None] * (1.5 + 0.5 * np.abs(pace)) + 3 * begin
    )


def view(angle: float) -> tuple[np.ndarray, np.ndarray]:
    """A camera that has gone round the body's middle by ``angle``."""
    c, s = np.cos(angle), np.sin(angle)
    R, middle = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]), np.array([0, 0, 4.0])
    return R, middle - R @ middle


def film(phase: np.ndarray, angle: float, seed: int, spread_m: float = 0.0) -> CalibratedVideo:
    rng = np.random.default_rng(seed)
    (R, t), true = view(angle), motion(phase)
    true = true + spread_m * rng.normal(size=(1, POINTS, 3))
    x = true @ R.T + t
    xy = (
        x[..., :2] / x[..., 2:] * K[0, 0] + K[:2, 2] + NOISE_PX * rng.normal(size=(*x.shape[:2], 2))
    )
    weight = np.where(rng.random(x.shape[:2]) < 0.05, 0.0, NOISE_PX**-2.0)
    return CalibratedVideo(true, xy, weight, K, R, t)


def blurred(true_at: np.ndarray, positions: np.ndarray, width: float) -> np.ndarray:
    soft = np.exp(-0.5 * ((true_at[:, None] - positions) / width) ** 2)
    return soft / soft.sum(1, keepdims=True)


def all_squares(*scene: Any) -> np.ndarray:
    """Of all frames and moments."""
    return reprojection_squares(*scene)(slice(None), slice(None))


def evidence_of_second(videos: list[CalibratedVideo], maps: list[np.ndarray]) -> np.ndarray | None:
    """Of the second video's frames, all positions of the first one."""
    banded = [BandedMap.of(m) for m in maps]
    nearby = [(rows, slice(0, maps[1].shape[1])) for rows in blocks_of_frames(len(maps[1]))]
    evidence = ReprojectionEvidence(videos)
    template = evidence.template(1, banded, 0, 4)
    squares = evidence.squares(1, template, banded[1], nearby, 4)
    return None if squares is None else squares.nearby.dense()


def test_derivatives_by_rigid_offsets_are_those_of_the_projection() -> None:
    video = film(np.linspace(0, 1, 3), 0.7, 1)
    x = motion(np.linspace(0, 1, 3))
    template, middle, small = projected(x, video), x.mean(1, keepdims=True), 1e-5
    for axis in range(3):
        turn = np.zeros(3)
        turn[axis] = small
        moved = x + np.cross(turn, x - middle)
        slope = (projected(moved, video).xy_px - template.xy_px) / small
        assert np.abs(slope - template.by_offset[..., axis]).max() < 0.1  # px per rad, of some 200
        slope = (projected(x + turn, video).xy_px - template.xy_px) / small
        assert np.abs(slope - template.by_offset[..., 3 + axis]).max() < 0.1


def test_a_performance_turned_and_shifted_keeps_its_time() -> None:
    phase = np.linspace(0, 4, 81)
    video = film(phase, 0.7, 2)
    turned = CalibratedVideo(
        video.xyz_m, video.xy_px + np.array([15.0, -8.0]), video.weight, K, video.R, video.t
    )
    squares = all_squares(projected(motion(phase), video), turned, np.arange(81))
    assert np.abs(squares.argmin(1) - np.arange(81)).mean() < 1.0
    assert np.median(squares.min(1)) < 1.5


def test_reprojection_sharpens_a_blurred_map() -> None:
    per_frame, frames = 4, 61
    reference, other = np.linspace(0, 6, frames), np.linspace(0.3, 5.7, 140)
    third = np.linspace(0, 6, 90)
    videos = [film(reference, 0.0, 3), film(other, 1.6, 4), film(third, 3.1, 5)]
    positions = np.arange((frames - 1) * per_frame + 1) / per_frame
    true = [phase / 6 * (frames - 1) for phase in (reference, other, third)]
    rng = np.random.default_rng(6)
    maps = [blurred(x + 1.0 * rng.normal(size=len(x)), positions, 1.5) for x in true]
    squares = evidence_of_second(videos, maps)
    error = np.abs(positions[squares.argmin(1)] - true[1])
    assert error.mean() < 0.25  # of reference frames; it was 0.8


@pytest.mark.long
@pytest.mark.parametrize(
    ("videos", "frames_off", "wrong"), [(2, 10, 0), (2, 10, 1), (3, 3, 1), (3, 30, 0)]
)
def test_poses_that_agree_with_a_wrong_map_are_corrected_by_reprojection(videos, frames_off, wrong):
    """As in the loop: each pose was found where its frame was taken to lie."""
    frames, rng = 121, np.random.default_rng(20)
    phase = np.linspace(0, 6, frames)
    off = frames_off * np.sin(np.pi * np.arange(frames) / (frames - 1))
    believed = np.interp(np.arange(frames) + off, np.arange(frames), phase)
    estimates = [motion(believed if v == wrong else phase) for v in range(videos)]
    films = [
        replace(film(phase, a, 21 + k), xyz_m=x)
        for k, (a, x) in enumerate(zip((0.0, 1.6, 3.1)[:videos], estimates, strict=True))
    ]
    poses = [x + 0.005 * rng.normal(size=x.shape) for x in estimates]
    params = replace(PARAMS, outliers="ignore", mirrored="ignore")

    def error(reprojection: ReprojectionEvidence | None) -> float:
        evidence = SyncEvidence(poses, [30.0] * videos, reference=0, reprojection=reprojection)
        result = synchronise(evidence, params, np.random.default_rng(0))
        others = np.stack(result.reference_frame[1:])
        return float(np.nanmean(np.abs(others - np.arange(frames)), axis=1).max())

    by_poses, by_reprojection = error(None), error(ReprojectionEvidence(films))
    assert by_poses > 0.55 * frames_off
    assert by_reprojection < 0.25


def test_a_time_that_stands_still_has_an_inverse() -> None:
    forward = increasing(np.array([0.0, 1.0, 1.0, 0.5, 2.0, 3.0]))
    assert (np.diff(forward) > 0).all()
    assert forward == pytest.approx([0.0, 5 / 6, 5 / 6, 5 / 6, 2.0, 3.0])


def test_reprojection_of_a_performance_that_differs_is_not_used() -> None:
    phase = np.linspace(0, 6, 61)
    videos = [film(phase, a, 7 + k, spread_m=0.08) for k, a in enumerate((0.0, 1.6, 3.1))]
    positions = np.arange(60 * 4 + 1) / 4
    maps = [blurred(np.arange(61.0), positions, 0.5)] * 3
    assert evidence_of_second(videos, maps) is None


def test_the_others_motion_is_without_the_video_itself() -> None:
    phase = np.linspace(0, 6, 61)
    videos = [film(phase, a, 10 + k) for k, a in enumerate((0.0, 1.6, 3.1))]
    positions = np.arange(60 * 4 + 1) / 4
    maps = [blurred(np.arange(61.0), positions, 0.3)] * 3
    squares = evidence_of_second(videos, maps)
    moved = CalibratedVideo(
        videos[1].xyz_m + 5.0, *(getattr(videos[1], n) for n in ("xy_px", "weight", "K", "R", "t"))
    )
    again = evidence_of_second([videos[0], moved, videos[2]], maps)
    assert again == pytest.approx(squares)


@pytest.mark.parametrize("off", [-6, 5])
def test_the_current_moment_of_a_frame_does_not_bias_its_counterpart(off: int) -> None:
    """Rigid offsets fitted there would absorb the error of time."""
    phase = np.linspace(0, 4, 81)
    video = film(phase, 0.7, 30)
    believed = np.clip(np.arange(81) + off, 0, 80)
    squares = all_squares(projected(motion(phase), video), video, believed)
    inner = slice(8, 73)
    error = squares.argmin(1)[inner] - np.arange(81)[inner]
    assert abs(error.mean()) < 0.1 * abs(off)
    assert np.abs(error).mean() < 1.0


@pytest.mark.parametrize("block", [256, 4])
def test_the_fit_of_rigid_offsets_at_every_moment_is_a_ridge_regression(block, monkeypatch):
    """Against a ridge regression for each frame and moment."""
    monkeypatch.setattr(offset_squares, "TEMPLATES", block)
    monkeypatch.setattr(offset_squares, "FRAMES", block)
    phase = np.linspace(0, 1, 6)
    video = film(phase, 0.4, 31)
    template, moments = projected(motion(phase), video), np.array([0, 1, 1, 3, 4, 5])
    squares = all_squares(template, video, moments)
    weight, precision = weights_and_precision(template, video, moments)
    for t in range(6):
        for s in range(6):
            root = np.sqrt(np.repeat(weight[t], 2))
            rows = root[:, None] * template.by_offset[s].reshape(-1, 6)
            right = root * (video.xy_px[t] - template.xy_px[s]).ravel()
            ridge = np.vstack([rows, np.diag(np.sqrt(precision))])
            answer, *_ = np.linalg.lstsq(ridge, np.concatenate([right, np.zeros(6)]))
            left = np.concatenate([right, np.zeros(6)]) - ridge @ answer
            count = (weight[t] / np.maximum(video.weight[t], 1e-12)).sum()
            assert squares[t, s] == pytest.approx(left @ left / (2 * count), rel=1e-8)


DEPTH = np.array([1.0, 1.0, -1.0])


def random_energies(seed: int, sizes: list[int]) -> tuple[list, dict]:
    rng = np.random.default_rng(seed)
    unary = [rng.random(n) for n in sizes]
    pairs = {
        (u, v): rng.random((sizes[u], sizes[v]))
        for u in range(len(sizes))
        for v in range(u + 1, len(sizes))
    }
    return unary, pairs


@pytest.mark.parametrize("seed", range(5))
def test_branch_and_bound_finds_what_enumeration_finds(seed: int) -> None:
    unary, pairs = random_energies(seed, [3, 1, 4, 2, 3])
    every = {x: energy_of(x, unary, pairs) for x in product(*map(range, (3, 1, 4, 2, 3)))}
    near = best_labellings(unary, pairs, margin=0.2)
    least = min(every.values())
    assert near[0].energy == pytest.approx(least)
    assert {x.labels for x in near} == {x for x, e in every.items() if e <= least + 0.2}


def test_twelve_videos_are_searched() -> None:
    unary, pairs = random_energies(1, [4] * 12)
    for (u, v), cost in pairs.items():  # one consistent choice among noise
        cost[u % 4, v % 4] -= 0.5
    assert best_labellings(unary, pairs, margin=0.0)[0].labels == tuple(v % 4 for v in range(12))


def test_reversed_depth_does_not_agree_with_a_right_motion() -> None:
    a, b = view_of(wandering(3, 12, 45), 0.3), view_of(wandering(3, 12, 45), 1.5)
    of_a, of_b = (CandidateMotions([x, x * DEPTH], filmed(x), np.zeros(2), 15.0) for x in (a, b))
    costs = pair_costs(of_a, of_b)
    assert costs[0, 0] < 0.6 * min(costs[0, 1], costs[1, 0])
    # both reversed are the mirror image of the scene, as good to cameras without perspective
    assert costs[1, 1] == pytest.approx(costs[0, 0], rel=0.2)


def candidates(wrong: tuple[int, ...], excess: float) -> list[CandidateMotions]:
    """Four videos of one motion; those in `wrong` have its reversed depth as the likeliest."""
    videos = []
    for v, azimuth in enumerate((0.0, 0.9, 2.0, 4.2)):
        right = view_of(wandering(7, 12, 45), azimuth)
        motions = [right, right * DEPTH]
        ordered = motions[::-1] if v in wrong else motions
        excesses = np.array([0.0, excess])
        videos.append(CandidateMotions(ordered, filmed(right), excesses, 15.0))
    return videos


@pytest.mark.parametrize("wrong", [(), (0,), (2,)])
def test_wrongly_started_videos_are_put_right(wrong: tuple[int, ...]) -> None:
    choice = choose_jointly(candidates(wrong, 5.0))
    assert choice.labels == tuple(int(v in wrong) for v in range(4))
    assert choice.rivals == [(), (), (), ()]


def test_two_of_four_reversed_are_a_tie_without_perspective_or_a_body() -> None:
    choice = choose_jointly(candidates((0, 3), 5.0))
    assert choice.labels in {(1, 0, 0, 1), (0, 1, 1, 0)}
    assert choice.rivals == [(1 - label,) for label in choice.labels]


def test_single_motions_leave_nothing_to_choose() -> None:
    films = candidates((), 5.0)
    one = [replace(v, motions=v.motions[:1], excess=v.excess[:1]) for v in films]
    assert choose_jointly(one) == JointChoice((0, 0, 0, 0), [(), (), (), ()])


def test_a_change_and_a_tie_are_said() -> None:
    choice = JointChoice((1, 0), [(), (1,)])
    changed, tie = sentences(choice, ["left", "right"], [["best", "depth"], ["best", "start 2"]])
    assert changed.startswith("left")
    assert "depth reversed" in changed
    assert tie.startswith("right")
    assert "do not decide" in tie

"""Whole videos are judged by what the others' common motion explains of their keypoints."""

import numpy as np
import pytest

from imocap_core.sync.screening.decisions import LARGEST_SCORE, Decisions, decide_by_keypoints
from imocap_core.sync.screening.explanation import (
    ScreenedVideo,
    mirrored_poses,
    motions_without,
    pair_residuals,
    prepared,
)
from imocap_core.sync.screening.registration import Keypoints2D, unbiased_directions
from imocap_core.sync.screening.screening import Screening, sentences
from tests.sync.made_motions import view_of
from tests.sync.test_screening import TWINS
from tests.sync.test_template import filmed, motion_of

AZIMUTHS = (0.0, 1.2, 2.4, 3.9)


def videos_of(motion: np.ndarray) -> list[ScreenedVideo]:
    """Four videos of a motion with the right monocular fits."""
    return [ScreenedVideo(view_of(motion, a), filmed(motion, a)) for a in AZIMUTHS]


def decided(videos: list[ScreenedVideo], **given: object) -> Decisions:
    """The decisions where nothing is stated by the user."""
    M = len(videos)
    arguments = {
        "pinned": [False] * M, "never_outliers": np.zeros(M, bool),
        "look_mirrored": True, "look_outliers": True,
    } | given  # fmt: skip
    return decide_by_keypoints(videos, TWINS, **arguments)  # type: ignore[arg-type]


def depth_reversed(video: ScreenedVideo) -> ScreenedVideo:
    """The same keypoints with a monocular fit whose depth is reversed."""
    return ScreenedVideo(video.motion * np.array([1.0, 1.0, -1.0]), video.keypoints)


@pytest.mark.long
def test_genuine_videos_stay_even_with_a_reversed_fit() -> None:
    videos = videos_of(motion_of(1))
    for suspect in (videos, [*videos[:3], depth_reversed(videos[3])]):
        result = decided(suspect)
        assert (result.mirrored, result.outliers, result.symmetric) == ((), (), False)
        assert (result.margin < -0.3).all()
        assert (result.score < LARGEST_SCORE).all()


@pytest.mark.parametrize("where", [pytest.param(0, marks=pytest.mark.long), 2])
def test_a_mirrored_video_is_mirrored_whatever_its_fit(where: int) -> None:
    videos = videos_of(motion_of(1))
    for flipped in (videos[where].mirrored(TWINS), depth_reversed(videos[where].mirrored(TWINS))):
        result = decided([flipped if v == where else x for v, x in enumerate(videos)])
        assert (result.mirrored, result.outliers) == ((where,), ())
        assert result.margin[where] > 0.3


@pytest.mark.parametrize("where", [pytest.param(0, marks=pytest.mark.long), 3])
def test_a_stranger_is_an_outlier_unless_it_must_stay_or_nobody_looks(where: int) -> None:
    videos = videos_of(motion_of(1))
    videos[where] = ScreenedVideo(view_of(motion_of(2), 0.5), filmed(motion_of(2), 0.5))
    result = decided(videos)
    assert result.outliers == (where,)
    assert result.score[where] > LARGEST_SCORE
    assert decided(videos, never_outliers=np.arange(4) == where).outliers != (where,)
    assert decided(videos, look_outliers=False).outliers == ()


def test_an_action_that_is_its_own_mirror_image_is_never_flipped_and_it_is_said() -> None:
    half = motion_of(4)
    videos = videos_of(0.5 * (half + mirrored_poses(half, TWINS)))
    result = decided([*videos[:3], videos[3].mirrored(TWINS)])
    assert result.mirrored == ()
    assert result.symmetric
    unknown = np.full(4, np.nan)
    screening = Screening((), (), (), (), unknown, unknown, symmetric=True)
    assert "own mirror image" in sentences(screening, "abcd")[0]


def with_noise(videos: list[ScreenedVideo], share: float) -> list[ScreenedVideo]:
    """Normal noise on the keypoints, a share of their spread in the first video."""
    rng, spread = np.random.default_rng(3), np.ptp(videos[0].keypoints.xy_px, axis=(0, 1)).max()
    films = [v.keypoints for v in videos]
    xy_px = [k.xy_px + rng.normal(0, share * spread, k.xy_px.shape) for k in films]
    noisy = [Keypoints2D(xy, k.weight) for xy, k in zip(xy_px, films, strict=True)]
    return [ScreenedVideo(v.motion, k) for v, k in zip(videos, noisy, strict=True)]


@pytest.mark.long
@pytest.mark.parametrize(("asymmetry", "both"), [(0.12, ()), (0.3, (1, 3))])
def test_two_mirrored_videos_have_to_be_clearer_than_one(asymmetry, both):
    half = motion_of(4)
    symmetric = 0.5 * (half + mirrored_poses(half, TWINS))
    videos = with_noise(videos_of(asymmetry * half + (1 - asymmetry) * symmetric), 0.03)
    one = decided([*videos[:3], videos[3].mirrored(TWINS)])
    two = decided([v.mirrored(TWINS) if k in (1, 3) else v for k, v in enumerate(videos)])
    assert (one.mirrored, one.symmetric) == ((3,), False)
    assert (two.mirrored, two.symmetric) == (both, not both)


def lastingly_wrong(video: ScreenedVideo, share: float, seed: int) -> ScreenedVideo:
    """The video as a detector sees it whose error at each joint lasts, a share of the spread."""
    k, rng = video.keypoints, np.random.default_rng([7, seed])
    error = rng.normal(0, share * k.xy_px.std(axis=1).mean(), (1, *k.xy_px.shape[1:]))
    return ScreenedVideo(video.motion, Keypoints2D(k.xy_px + error, k.weight))


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, 1])
def test_a_symmetric_action_is_never_mirrored_however_precise_or_wrong_its_videos(seed):
    half = motion_of(4 + seed)
    videos = videos_of(0.5 * (half + mirrored_poses(half, TWINS)))
    wrong = [lastingly_wrong(v, 0.02, 10 * seed + k) for k, v in enumerate(videos)]
    wrong[1] = lastingly_wrong(wrong[1], 0.15, seed)
    result = decided(wrong)
    assert (result.mirrored, result.outliers, result.symmetric) == ((), (), True)


@pytest.mark.long
def test_half_the_speed_a_bad_stretch_and_a_lasting_error_are_no_other_action() -> None:
    # a motion that changes little beside the pose that lasts, as push-ups and squats do
    motion = motion_of(1)
    videos = videos_of(np.asarray(motion.mean(axis=0) + 0.3 * (motion - motion.mean(axis=0))))
    slow = lastingly_wrong(depth_reversed(videos[2]), 0.4, 1)
    rows, rng = np.repeat(np.arange(60), 2), np.random.default_rng(2)
    xy_px = slow.keypoints.xy_px[rows]
    xy_px[50:70] += rng.normal(0, 2 * xy_px.std(axis=1).mean(), xy_px[50:70].shape)
    videos[2] = ScreenedVideo(slow.motion[rows], Keypoints2D(xy_px, slow.keypoints.weight[rows]))
    result = decided(videos)
    assert (result.outliers, result.mirrored) == ((), ())


@pytest.mark.long
def test_another_action_from_the_same_pose_is_still_another_action() -> None:
    pose = motion_of(1).mean(axis=0)
    other = pose + 0.6 * (motion_of(2) - motion_of(2).mean(axis=0))
    videos = videos_of(motion_of(1))
    videos[2] = ScreenedVideo(view_of(other, 0.5), filmed(other, 0.5))
    assert decided(videos).outliers == (2,)


def test_what_the_user_states_is_not_decided_again() -> None:
    videos = videos_of(motion_of(1))
    videos[2] = videos[2].mirrored(TWINS)
    assert decided(videos, pinned=[True] * 4).mirrored == ()
    assert decided(videos, look_mirrored=False).mirrored == ()


def test_the_common_motion_is_nearer_to_the_truth_than_flattened_fits() -> None:
    motion = motion_of(1)
    videos = videos_of(motion)
    flat = [x.motion * np.array([1.0, 1.0, 0.5]) for x in videos]
    films = [x.keypoints for x in videos]
    bent = [ScreenedVideo(x, k) for x, k in zip(flat, films, strict=True)]
    residuals = pair_residuals(bent, TWINS).plain
    common = motions_without(flat, films, residuals, unbiased_directions())
    truths = [view_of(motion, a) for a in AZIMUTHS]

    def error(estimate: np.ndarray) -> float:
        """Distance to the motion in the axes of whichever camera it is given in."""
        about = estimate - estimate.mean(axis=1, keepdims=True)
        return min(
            float(np.linalg.norm(about - (t - t.mean(axis=1, keepdims=True)), axis=-1).mean())
            for t in truths
        )

    assert np.mean([error(x) for x in common]) < 0.9 * np.mean([error(x) for x in flat])


def test_a_detector_that_swaps_sides_for_a_while_makes_no_stranger() -> None:
    videos = videos_of(motion_of(1))
    film = videos[1].keypoints
    swapped = film.xy_px.copy()
    swapped[18:42] = film.xy_px[18:42][:, list(TWINS)]
    videos[1] = ScreenedVideo(videos[1].motion, Keypoints2D(swapped, film.weight))
    result = decided(videos)
    assert (result.outliers, result.mirrored) == ((), ())


def test_joints_without_keypoints_are_left_out_and_twins_follow() -> None:
    videos = videos_of(motion_of(1))
    films = [Keypoints2D(x.keypoints.xy_px, x.keypoints.weight.copy()) for x in videos]
    for film in films:
        film.weight[:, 0] = 0.0  # its twin, joint 1, cannot be compared either
    short, twins = prepared([x.motion for x in videos], films, TWINS)
    assert {x.motion.shape[1] for x in short} == {10}
    assert [twins[t] for t in twins] == list(range(10))

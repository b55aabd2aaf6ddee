"""Whole videos are judged by what the others' common motion explains of their keypoints."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.sync.procrustes import centred, rotations_onto
from imocap_core.sync.screening.decisions import (
    LARGEST_SCORE,
    Decisions,
    decide_by_keypoints,
    find_outliers,
    outlier_scores,
)
from imocap_core.sync.screening.explanation import (
    ScreenedVideo,
    motions_without,
    pair_residuals,
    prepared,
)
from imocap_core.sync.screening.mirror import mirrored_poses
from imocap_core.sync.screening.pose_evidence import (
    expected_by,
    expected_squares,
    persistent_differences,
    persistent_squares,
    soft_maps,
    squares_between,
    typical_squares,
    warp_residuals,
)
from imocap_core.sync.screening.registration import Keypoints2D, unbiased_directions
from imocap_core.sync.screening.screening import Screening, sentences
from tests.sync.made_motions import view_of
from tests.sync.test_screening import TWINS
from tests.sync.test_synchronise import pose_at
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
    return [
        ScreenedVideo(
            v.motion,
            Keypoints2D(
                v.keypoints.xy_px + rng.normal(0, share * spread, v.keypoints.xy_px.shape),
                v.keypoints.weight,
            ),
        )
        for v in videos
    ]


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


def test_is_the_distance_of_every_frame_to_its_mean_counterpart() -> None:
    rng = np.random.default_rng(0)
    poses, others = rng.normal(size=(6, 5, 3)), rng.normal(size=(8, 5, 3))
    w, u, maps = rng.random((6, 5)), rng.random((8, 5)), rng.random((6, 8))
    w[2, 1], u[:, 3] = 0.0, 0.0
    maps /= maps.sum(axis=1, keepdims=True)
    squares = persistent_squares(poses, w, others, u, maps, window=2.0)

    about = centred(others, u)
    mean = np.zeros((6, 5, 3))
    both = np.zeros((6, 5))
    for t in range(6):
        for j in (0, 1, 2, 4):
            share = maps[t] * u[:, j]
            mean[t, j] = share @ about[:, j] / share.sum()
            both[t, j] = w[t, j] * share.sum()
    x, y = centred(poses, both), centred(mean, both)
    R = rotations_onto(x, y, both, 2.0)
    naive = [
        sum(both[t, j] * ((x[t, j] - y[t, j] @ R[t]) ** 2).sum() for j in range(5)) / both[t].sum()
        for t in range(6)
    ]
    np.testing.assert_allclose(squares, naive, atol=1e-12)


def test_a_rotation_of_the_whole_is_no_difference_and_missing_frames_are_nan() -> None:
    pose = pose_at(np.linspace(0, 4, 60))
    turn = Rotation.random(random_state=3).as_matrix()
    w = np.ones(pose.shape[:2])
    w[7] = 0.0
    square = persistent_squares(
        pose @ turn + [1.0, 2.0, 3.0], w, pose, np.ones_like(w), np.eye(60), 15.0
    )
    assert np.isnan(square[7])
    np.testing.assert_allclose(np.delete(square, 7), 0.0, atol=1e-18)


def test_noise_raises_it_less_than_a_lasting_difference_does() -> None:
    rng = np.random.default_rng(6)
    w = [np.ones((60, 12))] * 2
    pose, fps = pose_at(np.linspace(0, 6, 60)), [15.0, 15.0]

    def both(other: np.ndarray) -> tuple[float, float]:
        squares = squares_between([pose, other], w, [pose, other], w)
        typical = typical_squares(squares)
        plain = warp_residuals(expected_squares(squares, fps, typical, 4.0), 2)
        maps = soft_maps(squares, fps, typical, 4.0)
        persistent = persistent_differences([pose, other], w, maps, fps, 1.0)
        assert np.isnan(np.diag(persistent)).all()
        return np.nanmin(plain), np.nanmin(persistent)  # the better direction counts

    elsewhere = pose.copy()
    elsewhere[:, :4] += rng.normal(0.0, 0.12, (4, 3))  # a limb held otherwise all the time
    noisy = both(pose + rng.normal(0.0, 0.12, pose.shape))
    lasting = both(elsewhere)
    assert noisy[1] < 0.65 * noisy[0]
    assert lasting[1] > 0.8 * lasting[0]


def test_another_action_of_the_same_rhythm_is_an_outlier_unless_it_follows_clearly() -> None:
    residuals, gains = np.full((4, 4), 0.07), np.full((4, 4), 0.3)
    persistent = np.full((4, 4), 0.05)
    assert find_outliers(residuals, gains, persistent)[0] == []
    persistent[2] = persistent[:, 2] = 0.12
    assert find_outliers(residuals, gains, persistent)[0] == [2]
    assert find_outliers(residuals, gains + 0.3, persistent)[0] == []
    larger, smaller = (outlier_scores(residuals, gains, k * persistent)[2] for k in (1.0, 0.9))
    assert larger > smaller


def test_one_direction_is_enough_and_a_video_without_any_pair_has_no_score() -> None:
    residuals, gains = np.full((4, 4), 0.07), np.full((4, 4), 0.3)
    persistent = np.full((4, 4), 0.05)
    persistent[:3, 3] = 0.12  # a short clip: the others don't fit into it
    assert find_outliers(residuals, gains, persistent)[0] == []
    for pairs in (residuals, gains, persistent):
        pairs[0] = pairs[:, 0] = np.nan
    assert np.isnan(outlier_scores(residuals, gains, persistent)[0])


def test_expected_squares_from_given_maps_equal_those_that_compute_the_maps() -> None:
    rng = np.random.default_rng(2)
    shown = [pose_at(np.linspace(0, 6, n)) for n in (40, 30)]
    poses = [x + rng.normal(0.0, 0.02, x.shape) for x in shown]
    w, fps = [np.ones(x.shape[:2]) for x in poses], [15.0, 12.0]
    w[0][3] = 0.0
    squares = squares_between(poses, w, poses, w)
    typical = typical_squares(squares)
    expected = expected_squares(squares, fps, typical, 4.0)
    by_maps = expected_by(soft_maps(squares, fps, typical, 4.0), squares)
    assert by_maps.keys() == expected.keys() == {(0, 1), (1, 0)}
    for pair, squared in expected.items():
        np.testing.assert_array_equal(by_maps[pair], squared)

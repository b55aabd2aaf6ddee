"""People keep their names through crossings, gaps and false detections; the performer is chosen."""

import numpy as np
import pytest

from imocap_core.people import appearance, tracking
from imocap_core.people.performer import performer_of, ranked_tracks

SIZE, FPS = (640, 360), 30.0
OFFSETS = np.random.default_rng(0).uniform(-1, 1, size=(17, 2)) * [25, 60]


def person(x, y, scale=1.0, wave=0.0):
    """(17, 3): a fixed constellation, whose first four joints wave."""
    pose = np.concatenate([[x, y] + scale * OFFSETS, np.full((17, 1), 0.8)], axis=1)
    pose[:4, 1] += wave
    return pose


def choose(frames, **options):
    ranked = ranked_tracks(frames, SIZE, FPS, min_confidence=0.05, **options)
    return performer_of(ranked, 0, frames)


def performer_at(t):
    return person(100 + 4 * t, 180, wave=20 * np.sin(0.3 * t))


def bystander_at(t):
    return person(300, 170, scale=0.6)


def test_one_person_comes_back_as_given():
    frames = [performer_at(t)[None] for t in range(30)]
    performer = choose(frames)
    assert np.array_equal(performer.xy_px, np.stack(frames)[:, 0, :, :2])
    assert (performer.tracks_found, performer.presence) == (1, 1.0)


def test_the_order_of_detections_does_not_matter():
    rng = np.random.default_rng(1)
    frames = [np.stack([performer_at(t), bystander_at(t)]) for t in range(80)]
    shuffled = [frame[rng.permutation(2)] for frame in frames]
    assert np.array_equal(choose(frames).xy_px, choose(shuffled).xy_px)


def test_the_performer_is_kept_while_crossing_a_bystander():
    frames = [np.stack([bystander_at(t), performer_at(t)]) for t in range(80)]
    performer = choose(frames)
    assert performer.tracks_found == 2
    assert np.allclose(performer.xy_px, np.stack([performer_at(t)[:, :2] for t in range(80)]))


def test_frames_without_detection_stay_missing_and_the_track_goes_on():
    empty = np.zeros((0, 17, 3))
    frames = [empty if 20 <= t < 28 else performer_at(t)[None] for t in range(60)]
    performer = choose(frames)
    assert performer.tracks_found == 1
    assert np.isnan(performer.xy_px[20:28]).all()
    assert (performer.confidence[20:28] == 0).all()
    assert np.isnan(performer.box_px[20:28]).all()
    assert performer.presence == pytest.approx(52 / 60)


def test_a_long_gap_is_joined_where_the_person_comes_back():
    empty = np.zeros((0, 17, 3))
    frames = [empty if 30 <= t < 80 else person(200, 180, wave=t % 7)[None] for t in range(120)]
    assert choose(frames).tracks_found == 1


@pytest.mark.parametrize("wild", [range(30, 31), range(30, 34)])
def test_a_body_detected_upside_down_for_a_moment_is_the_same_person(wild):
    frames = [performer_at(t)[None] for t in range(60)]
    for t in wild:
        frames[t] = frames[t].copy()
        frames[t][..., 1] = 360 - frames[t][..., 1]
    assert tracking.pose_distance(frames[29][0], frames[30][0]) > tracking.GATE
    performer = choose(frames)
    assert (performer.tracks_found, performer.presence) == (1, 1.0)


def test_whoever_appears_beside_the_last_place_is_somebody_else():
    frames = [person(200, 180)[None]] * 30 + [person(260, 180)[None]] * 30
    assert choose(frames).tracks_found == 2


def test_a_false_detection_of_one_frame_is_nobody():
    frames = [performer_at(t)[None] for t in range(30)]
    frames[9] = np.concatenate([person(560, 60)[None], frames[9]])
    performer = choose(frames)
    assert performer.tracks_found == 1
    assert np.allclose(performer.xy_px[9], performer_at(9)[:, :2])


def test_a_person_seen_twice_in_one_frame_is_one():
    weaker = performer_at(0) + np.array([1.5, 1.0, -0.3])
    distinct = tracking.distinct_people(np.stack([weaker, performer_at(0)]), 0.05)
    assert np.array_equal(distinct, performer_at(0)[None])


def test_a_body_cut_in_two_is_made_whole():
    frames = [performer_at(t)[None] for t in range(30)]
    upper, lower = performer_at(12), performer_at(12)
    upper[8:], lower[:8] = (np.nan, np.nan, 0), (np.nan, np.nan, 0)
    frames[12] = np.stack([lower, upper])
    performer = choose(frames)
    assert np.array_equal(performer.xy_px[12], performer_at(12)[:, :2])
    assert performer.tracks_found == 1


def test_weak_points_are_missing():
    weak = performer_at(0)
    weak[5, 2] = 0.03
    distinct = tracking.distinct_people(weak[None], 0.05)
    assert np.isnan(distinct[0, 5, :2]).all()
    assert distinct[0, 5, 2] == 0


def test_distance_is_symmetric_and_free_of_scale():
    a, b = person(100, 100), person(130, 100)
    assert tracking.pose_distance(a, b) == tracking.pose_distance(b, a)
    bigger = [pose * [3, 3, 1] for pose in (a, b)]
    assert tracking.pose_distance(*bigger) == pytest.approx(tracking.pose_distance(a, b))


def test_every_detection_belongs_to_exactly_one_track():
    rng = np.random.default_rng(3)
    frames = [
        np.stack([person(*rng.uniform([50, 100], [600, 260])) for _ in range(3)]) for _ in range(20)
    ]
    tracks = tracking.follow(frames, max_gap=5)
    assert sum(len(track.frames) for track in tracks) == 60
    assert all(np.all(np.diff(track.frames) > 0) for track in tracks)


def test_nobody_is_said():
    performer = choose([np.zeros((0, 17, 3))] * 4)
    assert (performer.tracks_found, performer.presence) == (0, 0.0)
    assert "nobody" in performer.note


@pytest.mark.parametrize(
    ("count", "beside", "beside_px", "once", "once_px"),
    [
        (90, range(20, 24), 60, 60, 15),  # again much later, nearer
        # on the other side: both would find a track if the performer's went to the false one
        (60, range(30, 40), 40, 40, -25),
    ],
)
def test_a_false_person_takes_nobody_over(count, beside, beside_px, once, once_px):
    """Beside the performer for a few frames, and in one later."""
    performers = [performer_at(t) for t in range(count)]
    frames = [[performer] for performer in performers]
    for t, x in (*((t, beside_px) for t in beside), (once, once_px)):
        frames[t].append(performers[t] + [x, 0, 0])
    performer = choose([np.stack(people) for people in frames])
    assert performer.presence == 1.0
    assert np.allclose(performer.xy_px, np.stack(performers)[..., :2])


def test_a_second_detection_of_somebody_takes_nobody_over():
    """One body seen twice for some frames; then only one detection, nearer to the second."""
    frames = []
    for t in range(60):
        people = [performer_at(t)]
        if 30 <= t < 35:
            people = [performer_at(t) - [10, 0, 0], performer_at(t) + [12, 0, 0]]
        if t >= 35:
            people = [performer_at(t) + [12, 0, 0]]
        frames.append(np.stack(people))
    performer = choose(frames)
    assert performer.presence == 1.0


SHAPE = np.random.default_rng(0).uniform(-1, 1, (17, 2)) * [25, 60]
RED, BLUE = (200, 40, 40), (40, 60, 200)
FRAMES = range(60)


def pose(x: float) -> np.ndarray:
    return np.concatenate([[x, 180] + SHAPE, np.full((17, 1), 0.8)], axis=1)


def picture(people: list[tuple[float, tuple[int, int, int]]], seed: int) -> np.ndarray:
    shown = np.full((360, 640, 3), (90, 120, 80), np.float64)
    for x, colour in people:
        shown[110:250, max(0, int(x) - 28) : int(x) + 28] = colour
    noise = np.random.default_rng(seed).normal(0, 12, shown.shape)
    return np.clip(shown + noise, 0, 255).astype(np.uint8)


def film() -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Two people who walk through each other: (60, 2) places, red first, and the pictures."""
    x = [np.array([150 + 6.0 * t, 500 - 6.0 * t]) for t in FRAMES]
    shown = [picture([(p[0], RED), (p[1], BLUE)], t) for t, p in zip(FRAMES, x, strict=True)]
    return x, shown


def appearances_of(track: tracking.PersonTrack, shown: list[np.ndarray]) -> dict[int, np.ndarray]:
    return {
        f: appearance.appearance_of(shown[f], p)
        for f, p in zip(track.frames, track.poses, strict=True)
        if f % 3 == 0
    }


def test_other_clothes_look_other() -> None:
    shown = [picture([(150, RED)], s) for s in (0, 1)] + [picture([(150, BLUE)], 2)]
    red, again, blue = (appearance.appearance_of(x, pose(150)) for x in shown)
    assert appearance.appearance_distance(red, again) < 0.2
    assert appearance.appearance_distance(red, blue) > 0.6
    assert appearance.appearance_distance(red, blue) == appearance.appearance_distance(blue, red)
    assert np.isclose(red @ red, 1.0)


def test_ends_are_swapped_after_a_meeting_that_motion_got_wrong() -> None:
    x, shown = film()
    turned = [p if t < 30 else p[::-1] for t, p in zip(FRAMES, x, strict=True)]
    wrong = [tracking.PersonTrack(list(FRAMES), [pose(p[k]) for p in turned]) for k in (0, 1)]
    assert len(appearance.meetings(*wrong)) == 1
    tracks, appearances = appearance.swap_after_meetings(
        wrong, [appearances_of(t, shown) for t in wrong]
    )
    for k, track in enumerate(tracks):
        after = appearance.meetings(*wrong)[0][1] + 1
        right = [pose(p[k]) for p in x]
        np.testing.assert_array_equal(np.stack(track.poses[after:]), np.stack(right[after:]))
        assert track.frames == list(FRAMES)
        assert sorted(appearances[k]) == [f for f in FRAMES if f % 3 == 0]


def test_right_tracks_stay() -> None:
    x, shown = film()
    right = [tracking.PersonTrack(list(FRAMES), [pose(p[k]) for p in x]) for k in (0, 1)]
    tracks, _ = appearance.swap_after_meetings(right, [appearances_of(t, shown) for t in right])
    for before, after in zip(right, tracks, strict=True):
        np.testing.assert_array_equal(np.stack(before.poses), np.stack(after.poses))


@pytest.mark.parametrize(
    ("clothes_of_other", "lengths"), [(BLUE, [40, 60]), (RED, [20, 60, 20])], ids=["other", "same"]
)
def test_who_comes_back_elsewhere_is_joined_by_looks_where_nobody_else_looks_so(
    clothes_of_other, lengths
):
    shown = [picture([(150 if t < 25 else 520, RED), (300, clothes_of_other)], t) for t in FRAMES]
    gone = tracking.PersonTrack(list(range(20)), [pose(150)] * 20)
    back = tracking.PersonTrack(list(range(40, 60)), [pose(520)] * 20)
    both = [gone, tracking.PersonTrack(list(FRAMES), [pose(300)] * 60), back]
    tracks, _ = appearance.join_by_appearance(both, [appearances_of(t, shown) for t in both])
    assert [len(t.frames) for t in tracks] == lengths
    assert tracks[0].frames == [*range(20), *(range(40, 60) if len(tracks) == 2 else ())]


TRUNK = ("left_shoulder", "right_shoulder", "left_hip", "right_hip")
TALL_PX = np.full(90, 300.0)


def tilted(degrees):
    """(T, 4, 2) of somebody whose trunk is tilted by so many degrees in the picture."""
    hips = 80.0 * np.stack([np.sin(np.radians(degrees)), np.cos(np.radians(degrees))], axis=-1)
    across = np.array([[15.0, 5.0], [-15.0, -5.0]])
    return np.concatenate([0 * hips[:, None] + across, hips[:, None] + across], axis=1)


@pytest.mark.parametrize("stretch", [(0, 1), (0, 4), (30, 31), (40, 52), (87, 90)])
def test_frames_in_which_the_trunk_jumps_away_and_back_are_lost(stretch):
    away = np.isin(np.arange(90), np.arange(*stretch))
    xy = tilted(np.where(away, 160.0, 90.0)) + np.random.default_rng(0).normal(0, 1.0, (90, 4, 2))
    np.testing.assert_array_equal(tracking.lost_frames(xy, TALL_PX, TRUNK, FPS), away)


@pytest.mark.parametrize("stretch", [(0, 30), (20, 60), (60, 90)])
def test_frames_in_which_somebody_is_upside_down_of_a_sudden_are_lost_however_many(stretch):
    over = np.isin(np.arange(90), np.arange(*stretch))
    xy = tilted(np.where(over, 175.0, 5.0)) + np.random.default_rng(0).normal(0, 1.0, (90, 4, 2))
    np.testing.assert_array_equal(tracking.lost_frames(xy, TALL_PX, TRUNK, FPS), over)


def test_who_is_upright_again_after_one_jump_back_is_not_lost():
    """The detector turned the body over little by little, and back at once."""
    over = np.clip(np.arange(90) - 36, 0, 12) * 14.0 * (np.arange(90) < 52)
    lost = tracking.lost_frames(tilted(5.0 + over), TALL_PX, TRUNK, FPS)
    assert not lost[:40].any()
    assert not lost[52:].any()


def test_who_stays_away_a_somersault_and_one_wrong_hip_are_no_lost_frames():
    lies_down = tilted(np.where(np.arange(90) < 40, 0.0, 90.0))
    somersault = tilted(np.clip(np.arange(90) - 40, 0, 12) * 30.0)
    wrong_hip = tilted(np.full(90, 90.0)) + 150.0 * np.eye(90 * 4)[50 * 4 + 2].reshape(90, 4, 1)
    right = (lies_down, somersault, wrong_hip)
    assert not any(tracking.lost_frames(xy, TALL_PX, TRUNK, FPS).any() for xy in right)

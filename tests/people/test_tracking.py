"""People keep their names through crossings, gaps and false detections; the performer is chosen, as
who does what is done in the other videos too."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.people import appearance, tracking
from imocap_core.people.performer import (
    FramePlace,
    SeenMotion,
    choose_by_agreement,
    declared_performer,
    performer_of,
    pose_set_distances_m,
    ranked_tracks,
    rivals,
    row_at_place,
    row_of_number,
)

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


RED, BLUE = (200, 40, 40), (40, 60, 200)
FRAMES = range(60)


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
    red, again, blue = (appearance.appearance_of(x, person(150, 180)) for x in shown)
    assert appearance.appearance_distance(red, again) < 0.2
    assert appearance.appearance_distance(red, blue) > 0.6
    assert appearance.appearance_distance(red, blue) == appearance.appearance_distance(blue, red)
    assert np.isclose(red @ red, 1.0)


def test_ends_are_swapped_after_a_meeting_that_motion_got_wrong() -> None:
    x, shown = film()
    turned = [p if t < 30 else p[::-1] for t, p in zip(FRAMES, x, strict=True)]
    wrong = [
        tracking.PersonTrack(list(FRAMES), [person(p[k], 180) for p in turned]) for k in (0, 1)
    ]
    assert len(appearance.meetings(*wrong)) == 1
    tracks, appearances = appearance.swap_after_meetings(
        wrong, [appearances_of(t, shown) for t in wrong]
    )
    for k, track in enumerate(tracks):
        after = appearance.meetings(*wrong)[0][1] + 1
        right = [person(p[k], 180) for p in x]
        np.testing.assert_array_equal(np.stack(track.poses[after:]), np.stack(right[after:]))
        assert track.frames == list(FRAMES)
        assert sorted(appearances[k]) == [f for f in FRAMES if f % 3 == 0]


def test_right_tracks_stay() -> None:
    x, shown = film()
    right = [tracking.PersonTrack(list(FRAMES), [person(p[k], 180) for p in x]) for k in (0, 1)]
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
    gone = tracking.PersonTrack(list(range(20)), [person(150, 180)] * 20)
    back = tracking.PersonTrack(list(range(40, 60)), [person(520, 180)] * 20)
    both = [gone, tracking.PersonTrack(list(FRAMES), [person(300, 180)] * 60), back]
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


JUMPS = [((160.0, 90.0), s) for s in ((0, 1), (0, 4), (30, 31), (40, 52), (87, 90))]
UPSIDE_DOWN = [((175.0, 5.0), s) for s in ((0, 30), (20, 60), (60, 90))]  # lost however many


@pytest.mark.parametrize(("degrees", "stretch"), JUMPS + UPSIDE_DOWN)
def test_frames_in_which_the_trunk_jumps_or_is_upside_down_of_a_sudden_are_lost(degrees, stretch):
    away = np.isin(np.arange(90), np.arange(*stretch))
    xy = tilted(np.where(away, *degrees)) + np.random.default_rng(0).normal(0, 1.0, (90, 4, 2))
    np.testing.assert_array_equal(tracking.lost_frames(xy, TALL_PX, TRUNK, FPS), away)


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


def motion(seed: int, frames: int = 50) -> np.ndarray:
    """(T, 24, 3): a pose that goes through a cycle of its own."""
    rng = np.random.default_rng(seed)
    rest, first, second = rng.normal(0, 0.3, (3, 24, 3))
    phase = np.linspace(0, 2 * np.pi, frames)[:, None, None]
    return rest + 0.5 * np.cos(phase) * first + 0.5 * np.sin(phase) * second


def seen(joints: np.ndarray) -> SeenMotion:
    """A motion all of whose joints are seen."""
    return SeenMotion(joints, np.ones(joints.shape[:2]))


def view_of(seed: int, view: int, frames: int = 50, noise: float = 0.01) -> SeenMotion:
    """The same from another side, with noise."""
    rng = np.random.default_rng([seed, view])
    turn = Rotation.random(random_state=view).as_matrix()
    return seen(motion(seed, frames) @ turn.T + rng.normal(0, noise, (frames, 24, 3)))


def test_a_larger_stranger_is_not_the_performer() -> None:
    """One video shows somebody with a larger score who does something else."""
    scores = [[1.0, 0.6], [1.0], [1.0]]
    poses = [[view_of(8, 0), view_of(1, 1)], [view_of(1, 2, 41)], [view_of(1, 3, 63)]]
    assert choose_by_agreement(scores, poses) == [1, 0, 0]


def test_somebody_who_stands_by_in_every_video_does_not_perform() -> None:
    """Nearer to each other than the performers are, because nothing moves."""
    rng = np.random.default_rng(3)
    still = motion(9)[:1] + rng.normal(0, 0.01, (3, 50, 24, 3))
    offsets = rng.normal(0, 0.02, (3, 24, 3))
    poses = [[seen(still[v]), seen(view_of(1, v).joints_m + offsets[v])] for v in range(3)]
    standing, performing = (pose_set_distances_m(poses[0][k], poses[1][k])[0] for k in (0, 1))
    assert standing < 0.8 * performing
    assert choose_by_agreement([[1.0, 0.9]] * 3, poses) == [1, 1, 1]


def test_the_larger_of_two_who_do_the_same_performs() -> None:
    poses = [[view_of(1, 0), view_of(1, 1)], [view_of(1, 2)]]
    assert choose_by_agreement([[1.0, 0.6], [1.0]], poses) == [0, 0]


def test_what_a_detector_guesses_of_hidden_limbs_does_not_count() -> None:
    """The performer's legs are hidden in a third of each video, and guessed otherwise each time; a
    bystander in full view moves a little, alike in all."""
    legs = [k for k, name in enumerate(SMPL_JOINTS) if "knee" in name or "ankle" in name]
    poses = []
    for v, first in enumerate((0, 15, 30)):
        performer = view_of(1, v, noise=0.05)
        hidden = np.ix_(range(first, first + 20), legs)
        performer.joints_m[hidden] += np.random.default_rng(v).normal(0, 0.4, (20, len(legs), 3))
        performer.visibility[hidden] = 0.02
        poses.append([performer, view_of(2, v, noise=0.05)])
    blind = [[seen(performer.joints_m), other] for performer, other in poses]
    assert choose_by_agreement([[1.0, 0.8]] * 3, blind) == [1, 1, 1]
    assert choose_by_agreement([[1.0, 0.8]] * 3, poses) == [0, 0, 0]


def test_all_ways_and_one_at_a_time_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    scores = [[1.0, 0.8], [1.0, 0.9], [1.0], [1.0, 0.5]]
    poses = [[view_of(7, 0), view_of(1, 1)], [view_of(1, 2), view_of(6, 3)], [view_of(1, 4)],
             [view_of(5, 5), view_of(1, 6)]]  # fmt: skip
    every = choose_by_agreement(scores, poses)
    monkeypatch.setattr("imocap_core.people.performer.MAX_COMBINATIONS", 1)
    assert every == choose_by_agreement(scores, poses) == [1, 0, 0, 1]


def test_one_video_alone_takes_the_score() -> None:
    assert choose_by_agreement([[1.0, 0.9]], [[view_of(1, 0), view_of(2, 0)]]) == [0]


def test_distance_of_sets_is_symmetric_and_blind_to_sides_and_order() -> None:
    a, b = view_of(1, 0), view_of(2, 1)
    assert pose_set_distances_m(a, b) == pytest.approx(pose_set_distances_m(b, a))
    turned = seen(a.joints_m[::-1] @ Rotation.random(random_state=3).as_matrix().T)
    assert pose_set_distances_m(turned, b) == pytest.approx(pose_set_distances_m(a, b), rel=1e-6)
    assert pose_set_distances_m(a, a)[0] < 1e-6
    moving, still = pose_set_distances_m(a, b)
    assert moving < still
    alone = (seen(motion.joints_m[:1]) for motion in (a, b))
    assert len(set(pose_set_distances_m(*alone))) == 1  # a pose alone is still


def test_only_those_near_the_best_are_thought_of() -> None:
    assert rivals([1.0, 0.5, 0.41, 0.3]) == [0, 1, 2]


PEOPLE = [
    np.stack([person(150, 180, wave=20 * np.sin(0.3 * t)), person(450, 180)]) for t in range(60)
]
RANKED = ranked_tracks(PEOPLE, (640, 360), 30.0, min_confidence=0.05)


def x_of(row: int) -> float:
    return float(np.nanmean(declared_performer(RANKED, row, PEOPLE).xy_px[:, 5:, 0]))


def test_by_number() -> None:
    assert x_of(row_of_number(RANKED, 1)) == pytest.approx(150, abs=20)
    assert x_of(row_of_number(RANKED, 2)) == pytest.approx(450, abs=20)
    with pytest.raises(ValueError, match="track: expected 1 to 2, got 3"):
        row_of_number(RANKED, 3)


@pytest.mark.parametrize(
    "place",
    [
        FramePlace(10, point_px=(640, 20)),
        FramePlace(10, box_px=(0, 0, 20, 20)),
        FramePlace(99, (150, 180)),
    ],
)
def test_an_error_lists_who_is_in_the_frame(place: FramePlace) -> None:
    with pytest.raises(ValueError, match=r"got nobody; in that frame there are: (track 1 at|none)"):
        row_at_place(RANKED, place)


def test_the_note_names_the_declaration() -> None:
    assert "as action.yaml declares" in declared_performer(RANKED, 1, PEOPLE).note

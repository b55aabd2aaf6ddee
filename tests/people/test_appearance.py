"""People keep their names by their clothes where motion alone would lose them."""

import numpy as np

from imocap_core.people.appearance import (
    appearance_distance,
    appearance_of,
    join_by_appearance,
    meetings,
    swap_after_meetings,
)
from imocap_core.people.tracking import PersonTrack

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


def appearances_of(track: PersonTrack, shown: list[np.ndarray]) -> dict[int, np.ndarray]:
    return {
        f: appearance_of(shown[f], p)
        for f, p in zip(track.frames, track.poses, strict=True)
        if f % 3 == 0
    }


def test_other_clothes_look_other() -> None:
    shown = [picture([(150, RED)], s) for s in (0, 1)] + [picture([(150, BLUE)], 2)]
    red, again, blue = (appearance_of(x, pose(150)) for x in shown)
    assert appearance_distance(red, again) < 0.2
    assert appearance_distance(red, blue) > 0.6
    assert appearance_distance(red, blue) == appearance_distance(blue, red)
    assert np.isclose(red @ red, 1.0)


def test_ends_are_swapped_after_a_meeting_that_motion_got_wrong() -> None:
    x, shown = film()
    turned = [p if t < 30 else p[::-1] for t, p in zip(FRAMES, x, strict=True)]
    wrong = [PersonTrack(list(FRAMES), [pose(p[k]) for p in turned]) for k in (0, 1)]
    assert len(meetings(*wrong)) == 1
    tracks, appearances = swap_after_meetings(wrong, [appearances_of(t, shown) for t in wrong])
    for k, track in enumerate(tracks):
        after = meetings(*wrong)[0][1] + 1
        right = [pose(p[k]) for p in x]
        np.testing.assert_array_equal(np.stack(track.poses[after:]), np.stack(right[after:]))
        assert track.frames == list(FRAMES)
        assert sorted(appearances[k]) == [f for f in FRAMES if f % 3 == 0]


def test_right_tracks_stay() -> None:
    x, shown = film()
    right = [PersonTrack(list(FRAMES), [pose(p[k]) for p in x]) for k in (0, 1)]
    tracks, _ = swap_after_meetings(right, [appearances_of(t, shown) for t in right])
    for before, after in zip(right, tracks, strict=True):
        np.testing.assert_array_equal(np.stack(before.poses), np.stack(after.poses))


def test_who_comes_back_elsewhere_is_the_same_by_looks() -> None:
    shown = [picture([(150 if t < 25 else 520, RED), (300, BLUE)], t) for t in FRAMES]
    gone = PersonTrack(list(range(20)), [pose(150)] * 20)
    back = PersonTrack(list(range(40, 60)), [pose(520)] * 20)
    other = PersonTrack(list(FRAMES), [pose(300)] * 60)
    tracks, _ = join_by_appearance(
        [gone, other, back], [appearances_of(t, shown) for t in (gone, other, back)]
    )
    assert [len(t.frames) for t in tracks] == [40, 60]
    assert tracks[0].frames == [*range(20), *range(40, 60)]


def test_two_in_the_same_clothes_are_not_joined_for_them() -> None:
    shown = [picture([(150 if t < 25 else 520, RED), (300, RED)], t) for t in FRAMES]
    gone = PersonTrack(list(range(20)), [pose(150)] * 20)
    back = PersonTrack(list(range(40, 60)), [pose(520)] * 20)
    other = PersonTrack(list(FRAMES), [pose(300)] * 60)
    tracks, _ = join_by_appearance(
        [gone, other, back], [appearances_of(t, shown) for t in (gone, other, back)]
    )
    assert len(tracks) == 3

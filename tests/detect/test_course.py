"""Everybody through a video: laws on pictures of bars (`made_people`)."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from imocap_core.detect.workers.blazepose.boxes import (
    LIMBS,
    PATIENCE,
    distinct,
    is_duplicate,
    shared,
    size_of,
    with_hidden,
)
from imocap_core.detect.workers.blazepose.course import EVERY, Course
from imocap_core.detect.workers.blazepose.landmarks import (
    Crop,
    Landmarks,
    Pyramid,
    detect_landmarks,
    mask_in,
)
from imocap_core.detect.workers.blazepose.looks import (
    ESTABLISHED,
    LARGEST_ERROR,
    LONGEST,
    FollowedPerson,
    Look,
    between,
    interpolation_error,
    is_even,
    merged,
)
from tests.detect.made_people import (
    HEIGHT,
    WIDTH,
    Network,
    blind_network,
    blind_person_detector,
    box_network,
    drifting_network,
    landmark_network,
    person_detector,
    picture,
)


def followed(
    pictures: Iterable[np.ndarray],
    boxes: Callable[[int], Network] = lambda frame: box_network(),
    most_people: int = 5,
    person_detector: Network = blind_person_detector,
    landmarks: Network = landmark_network,
    every_picture: bool = False,
) -> list[list[Landmarks]]:
    """The people in each picture, also those who are known later; `boxes`: the network by frame."""
    frame = 0

    def network(given: np.ndarray) -> list[np.ndarray]:
        return boxes(frame)(given)

    course = Course(
        network, person_detector, landmarks, 0.5, 0.5, most_people, every_picture=every_picture
    )
    bodies: list[list[Landmarks]] = []
    all_pictures = [*pictures]
    for frame, made in enumerate(all_pictures):
        people, earlier = course.next_people(made, is_last=frame == len(all_pictures) - 1)
        bodies.append(list(people))
        for ago, body in earlier:
            bodies[frame - ago].append(body)
    return bodies


def places(pictures: Iterable[np.ndarray], *given: Any, **options: Any) -> list[list[Any]]:
    """Middles of the people in each picture, from left to right; as `followed`."""
    return [sorted(map(middle, people)) for people in followed(pictures, *given, **options)]


def middle(body: Landmarks) -> tuple[int, int]:
    x, y = body.xy_px.min(axis=0) / 2 + body.xy_px.max(axis=0) / 2
    return round(float(x)), round(float(y))


def test_everybody_is_followed() -> None:
    walk = [picture((100 + 4 * t, 150), (450 - 3 * t, 250)) for t in range(12)]
    for t, people in enumerate(places(walk)):
        assert np.allclose(people, [(100 + 4 * t, 150), (450 - 3 * t, 250)], atol=8)


def test_people_are_followed_while_the_detector_is_blind() -> None:
    walk = [picture((100 + 4 * t, 150)) for t in range(3 * EVERY)]
    people = places(walk, lambda frame: blind_network if frame else box_network())
    assert [len(in_frame) for in_frame in people] == [1] * len(walk)


def test_a_drifting_crop_is_led_back_by_the_person_detector() -> None:
    """Crops that follow answers stay behind a runner and lose him; where BlazePose's own detector
    has him, they do not."""
    steps = range(3 * EVERY)
    run = [picture((100 + 14 * t, 150)) for t in steps]

    def once(frame: int) -> Network:
        return blind_network if frame else box_network()

    alone = places(run, once, landmarks=drifting_network)
    assert not alone[-1]
    led = places(run, once, person_detector=person_detector, landmarks=drifting_network)
    assert [len(in_frame) for in_frame in led] == [1] * len(run)
    assert np.allclose([in_frame[0] for in_frame in led], [(100 + 14 * t, 150) for t in steps],
                       atol=20)  # fmt: skip


def test_somebody_detected_late_is_followed_backward_too() -> None:
    walk = [picture((300, 150 + 4 * t)) for t in range(4 * EVERY)]
    late = places(walk, lambda frame: box_network() if frame >= 2 * EVERY else blind_network)
    assert [len(in_frame) for in_frame in late] == [1] * len(walk)
    assert np.allclose([in_frame[0] for in_frame in late], [(300, 150 + 4 * t) for t in range(20)],
                       atol=8)  # fmt: skip


def test_somebody_who_left_and_came_back_is_nobody_between() -> None:
    present = [t < 8 or t >= 12 for t in range(24)]
    walk = [picture((300, 150)) if here else picture() for here in present]
    assert [len(in_frame) for in_frame in places(walk)] == [int(here) for here in present]


def test_two_people_who_cross_stay_two() -> None:
    steps = range(0, 33)
    walk = [picture((200 + 6 * t, 200), (400 - 6 * t, 200)) for t in steps]
    people = places(walk)
    for t in steps:
        first, second = 200 + 6 * t, 400 - 6 * t
        if abs(first - second) > 2 * WIDTH:
            assert np.allclose(people[t], sorted([(first, 200), (second, 200)]), atol=12)
        assert 1 <= len(people[t]) <= 2
    assert len(people[-1]) == 2


def test_no_more_people_than_allowed() -> None:
    crowd = [picture((100, 150), (300, 150), (500, 150))] * 3
    assert [len(in_frame) for in_frame in places(crowd, most_people=2)] == [2, 2, 2]


def test_the_allowed_stay_the_same() -> None:
    """Somebody who comes later and is as large takes nobody's place."""
    walk = [picture((100, 150), *[(400, 200)] * (t > 2)) for t in range(3 * EVERY)]
    assert all(np.allclose(p, [(100, 150)], atol=8) for p in places(walk, most_people=1))


def test_a_box_with_nobody_in_it_is_not_looked_at_again_soon() -> None:
    """A poster: the person detector takes it for somebody, the landmark network does not."""
    looks = 0

    def nobody(given: np.ndarray) -> list[np.ndarray]:
        nonlocal looks
        looks += 1
        rows, presence, *others = landmark_network(given)
        return [rows, 0 * presence, *others]

    frames = 2 * PATIENCE
    assert places([picture((300, 150))] * frames, landmarks=nobody) == [[]] * frames
    assert looks == frames  # nobody is followed, so that the whole picture is looked at in each
    looks = 0

    def no_poster(given: np.ndarray) -> list[np.ndarray]:
        nonlocal looks
        is_poster = (given[..., 1] > 0.5).sum() > (given[..., 0] > 0.5).sum()
        looks += is_poster
        return nobody(given) if is_poster else landmark_network(given)

    people = places([picture((100, 150), (450, 150))] * frames, landmarks=no_poster)
    assert [len(in_frame) for in_frame in people] == [1] * frames
    assert 2 <= looks // 2 <= 3


def test_who_was_lost_is_looked_for_in_every_box() -> None:
    """One who could not be told from a poster at first is found when somebody is lost."""
    frame, known, lost = 0, 8, 12

    def boxes(now: int) -> Network:
        nonlocal frame
        frame = now
        return box_network()

    def late(given: np.ndarray) -> list[np.ndarray]:
        rows, presence, *others = landmark_network(given)
        is_late = (given[..., 1] > 0.5).sum() > (given[..., 0] > 0.5).sum()
        return [rows, presence * (frame >= known or not is_late), *others]

    walk = [picture((100, 150) if t < lost else (-100, 150), (450, 150)) for t in range(PATIENCE)]
    people = places(walk, boxes, landmarks=late)
    assert [len(in_frame) for in_frame in people[lost:]] == [1] * (PATIENCE - lost)


@pytest.mark.long
def test_who_is_detected_where_pictures_waited_is_followed_backward_to_the_start() -> None:
    """Of three who stand still one is overlooked, until another leaves: whichever of the pictures
    that wait for a fourth it is."""

    def overlooking(frame: int, leaves: int) -> Network:
        def network(given: np.ndarray) -> list[np.ndarray]:
            others = given.copy()
            if frame < leaves:
                others[..., 2] = -1.0  # the third one's colour
            return box_network()(others)

        return network

    for leaves in (14, 15, 16, 17):
        stand = [
            picture((100, 150), (300, 150) if t < leaves else (-100, 150), (500, 150))
            for t in range(30)
        ]
        people = places(stand, lambda frame, leaves=leaves: overlooking(frame, leaves))  # type: ignore[misc]
        assert [len(in_frame) for in_frame in people] == [2 + (t < leaves) for t in range(30)]


def test_who_is_new_takes_nobodys_place() -> None:
    made = picture((200, 200))
    body = looked(made, 200.0)
    known = FollowedPerson(
        replace(body, visibility=0.5 * body.visibility), body, age=ESTABLISHED + 1
    )
    new = FollowedPerson(body, body, age=1)
    assert merged([new, known], []) == [known]
    assert merged([known], [body]) == [known]
    assert merged([replace(known, age=1), new], []) == [new]


def test_nobody_is_nobody() -> None:
    assert places([picture()] * 3) == [[], [], []]


def looked(made: np.ndarray, x: float, others: tuple[Landmarks, ...] = ()) -> Landmarks:
    crop = Crop(x, 200.0, 1.3 * HEIGHT, 0.0)
    return detect_landmarks(Pyramid(made), crop, landmark_network, others)


def test_two_crops_that_landed_on_one_person_are_one() -> None:
    made = picture((200, 200), (450, 200))
    bodies = [looked(made, x) for x in (190.0, 210.0, 450.0)]
    assert is_duplicate(bodies[1], [bodies[0]])
    assert shared(bodies[0], [bodies[0]]) == 1.0
    assert not is_duplicate(bodies[2], bodies[:2])
    assert len(distinct(bodies, [0, 0, 0])) == 2


def test_a_mask_lies_where_its_person_is_in_any_crop() -> None:
    body = looked(picture((200, 200)), 190.0)
    crop = Crop(230.0, 180.0, 200.0, 0.5)
    mask = mask_in(crop, body)
    y, x = np.nonzero(mask > 0.5)
    inside = crop.in_picture(np.column_stack([x + 0.5, y + 0.5]) / 256)
    assert np.abs(inside[:, 0] - 200).max() < WIDTH / 2 + 3
    assert np.abs(inside[:, 1] - 200).max() < HEIGHT / 2 + 3
    assert (mask > 0.5).sum() * (200 / 256) ** 2 > 0.9 * WIDTH * HEIGHT


def test_joints_behind_somebody_are_said_to_be_hidden() -> None:
    """Of two who overlap by half, the one behind has its joints of that side hidden."""
    nearer, alone = looked(picture((200, 200)), 200.0), looked(picture((220, 200)), 220.0)
    behind = replace(alone, mask=alone.mask * (mask_in(alone.crop, nearer) < 0.5))
    bodies = with_hidden([nearer, behind])
    assert np.array_equal(bodies[0].visibility, nearer.visibility)
    edge = np.abs(behind.xy_px - (220, 260)).min(axis=1) < 3  # of the nearer one's pixels
    left = (behind.xy_px[:, 0] < 220) & ~edge
    assert left.any()
    assert (bodies[1].visibility[left] < 0.2 * behind.visibility[left]).all()
    right = (behind.xy_px[:, 0] > 220) & ~edge
    assert np.array_equal(bodies[1].visibility[right], behind.visibility[right])
    assert np.array_equal(with_hidden([behind])[0].visibility, behind.visibility)


def test_a_person_painted_over_makes_room_for_the_one_behind() -> None:
    made = picture((200, 200), (230, 200))
    nearer = looked(made, 200.0)
    assert abs(middle(looked(made, 205.0))[0] - 200) < 12
    assert middle(looked(made, 205.0, (nearer,)))[0] > 215


WRIST, NOSE = 15, 0
CROP = Crop(200.0, 200.0, 160.0, 0.0)
BODY = detect_landmarks(Pyramid(picture((200, 200))), CROP, landmark_network)


def at(frame: int, shift: np.ndarray) -> Look:
    """A body whose joints are shifted by (33, 2) or (2,) pixels."""
    return Look(frame, replace(BODY, xy_px=BODY.xy_px + shift))


@pytest.mark.parametrize("frames", [(0, 1, 2), (0, 2, 4), (3, 4, 6)])
def test_uniform_motion_is_interpolated_exactly(frames: tuple[int, int, int]) -> None:
    looks = [at(t, np.array([3.0, -2.0]) * t) for t in frames]
    assert interpolation_error(looks, gap=2) == pytest.approx(0.0, abs=1e-12)
    middle = between(looks[1].body, looks[2].body, 0.5)
    expected = BODY.xy_px + np.array([3.0, -2.0]) * (frames[1] + frames[2]) / 2
    assert np.allclose(middle.xy_px, expected)


@pytest.mark.parametrize("frames", [(0, 2, 4), (1, 2, 4)])
def test_the_error_is_that_of_a_parabola(frames: tuple[int, int, int]) -> None:
    """Halfway between two looks a parabola differs from its chord by what is told, whatever the
    distance of the first look."""
    bend = np.zeros((33, 2))
    bend[WRIST] = 1.5, 2.0  # pixels per frame^2, halved below
    looks = [at(t, bend * t**2 / 2) for t in frames]
    middle = between(looks[1].body, looks[2].body, 0.5)
    true = BODY.xy_px + bend * ((frames[1] + frames[2]) / 2) ** 2 / 2
    error = np.linalg.norm(middle.xy_px - true, axis=1).max() / size_of(looks[2].body)
    assert interpolation_error(looks, gap=frames[2] - frames[1]) == pytest.approx(error)


def test_hidden_joints_and_the_face_do_not_count() -> None:
    bend, visibility = np.zeros((33, 2)), BODY.visibility.copy()
    bend[NOSE] = bend[WRIST] = 30.0
    visibility[WRIST] = 0.2
    looks = [at(t, bend * t**2) for t in range(3)]
    assert not is_even(looks, gap=2)
    dimmed = [replace(looks[1], body=replace(looks[1].body, visibility=visibility))]
    assert is_even([looks[0], *dimmed, looks[2]], gap=2)
    assert not is_even(looks[:2], gap=2)
    assert WRIST in LIMBS
    assert NOSE not in LIMBS


def course(
    pictures: list[np.ndarray], every_picture: bool = False
) -> tuple[list[list[float]], int]:
    """x of the people in each picture, and how often the landmark network looked."""
    looks = 0

    def counted(given: np.ndarray) -> list[np.ndarray]:
        nonlocal looks
        looks += 1
        return landmark_network(given)

    bodies = followed(pictures, landmarks=counted, every_picture=every_picture)
    return [sorted(float(b.xy_px[:, 0].mean()) for b in people) for people in bodies], looks


@pytest.mark.parametrize("length", [24, 25, 26, 27])
def test_of_an_even_walk_one_picture_in_four_is_looked_at(length: int) -> None:
    walk = [picture((100 + 4 * t, 150), (450 - 2 * t, 250)) for t in range(length)]
    every, all_looks = course(walk, every_picture=True)
    some, looks = course(walk)
    assert [len(people) for people in some] == [2] * length
    assert np.allclose(some, every, atol=0.02 * HEIGHT)
    followed_closely = EVERY + 3
    spared = (length - followed_closely) * (LONGEST - 1) // LONGEST
    assert looks <= all_looks - 2 * spared + 4


def test_who_is_in_anothers_way_is_looked_at_in_every_second_picture() -> None:
    waits = []
    for distance in (200, 25):
        both = picture((200, 150), (200 + distance, 150))
        made = Course(box_network(), blind_person_detector, landmark_network, 0.5, 0.5, 5)
        people = [made.next_people(both)[0] for _ in range(24)]
        waits.append(people.count([]))
    assert waits[0] > waits[1] > 0
    assert waits[1] <= 12


def test_a_start_that_nothing_announced_is_looked_at() -> None:
    """Still, then fast: the picture that waited when it began is looked at after all."""
    places = [100.0] * 13 + [100.0 + 8 * t for t in range(1, 12)]
    for first in (0, 1):  # the start falls on a picture that waits, and on one that does not
        walk = [picture((x, 150)) for x in places[first:]]
        every, _ = course(walk, every_picture=True)
        some, _ = course(walk)
        assert [len(people) for people in some] == [1] * len(walk)
        assert np.abs(np.array(some) - every).max() <= LARGEST_ERROR * 1.5 * HEIGHT + 0.5


def test_somebody_who_leaves_is_missing_in_the_same_pictures() -> None:
    for leaves in (14, 15, 16, 17):
        walk = [picture((100, 150)) if t < leaves else picture() for t in range(22)]
        some, _ = course(walk)
        assert [len(people) for people in some] == [int(t < leaves) for t in range(22)]


def test_somebody_who_comes_is_followed_backward_through_pictures_that_waited() -> None:
    for comes in (14, 15, 16, 17):
        both = [picture((100, 150), *[(400, 200)] * (t >= comes)) for t in range(36)]
        some, _ = course(both)
        assert [len(people) for people in some] == [1 + int(t >= comes) for t in range(36)]

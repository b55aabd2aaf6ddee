"""Even motion: pictures between two looks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from imocap_core.detect.workers.blazepose.boxes import LIMBS, size_of
from imocap_core.detect.workers.blazepose.course import EVERY, Course
from imocap_core.detect.workers.blazepose.landmarks import (
    Crop,
    Landmarks,
    Pyramid,
    detect_landmarks,
)
from imocap_core.detect.workers.blazepose.looks import (
    LARGEST_ERROR,
    LONGEST,
    Look,
    between,
    interpolation_error,
    is_even,
)
from tests.detect.made_people import (
    HEIGHT,
    Network,
    blind_person_detector,
    box_network,
    landmark_network,
    picture,
)

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

    network: Network = box_network()
    made = Course(network, blind_person_detector, counted, 0.5, 0.5, 5, every_picture=every_picture)
    bodies: list[list[Landmarks]] = []
    for frame, one in enumerate(pictures):
        people, earlier = made.next_people(one, frame == len(pictures) - 1)
        bodies.append(list(people))
        for ago, body in earlier:
            bodies[frame - ago].append(body)
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

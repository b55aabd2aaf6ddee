"""BlazePose's parts, with networks that are functions: where crops lie, what outputs mean."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from imocap_core.detect.workers.blazepose.course import Course, is_same
from imocap_core.detect.workers.blazepose.crops import MARGIN, Crop, about, pixels, whole
from imocap_core.detect.workers.blazepose.landmarks import POINTS, detect_landmarks, refined
from imocap_core.detect.workers.blazepose.person import anchors, detect_people

Network = Callable[[np.ndarray], list[np.ndarray]]
BLACK = np.zeros((300, 200, 3), np.uint8)
COLD = np.full((64, 64, POINTS), -10.0, np.float32)


def slope(height: int, width: int) -> np.ndarray:
    """A picture whose red is its column and green its row, in quarters."""
    y, x = np.mgrid[:height, :width]
    return np.stack([x / 4, y / 4, 0 * x], axis=-1).round().astype(np.uint8)


@pytest.mark.parametrize("angle", [0.0, 0.4, -2.0])
@pytest.mark.parametrize("side", [64.0, 200.0, 700.0])
def test_a_crop_s_pixels_are_the_picture_s_at_its_points(angle: float, side: float) -> None:
    crop = Crop(430.0, 510.0, side, angle)
    cut = pixels(slope(1000, 1000), crop, 64).astype(float)
    centres = (np.stack(np.meshgrid(*[np.arange(64)] * 2), axis=-1) + 0.5) / 64
    there = crop.in_picture(centres) - 0.5  # of the pixel whose centre it is
    inside = ((there > 8) & (there < 991)).all(axis=-1)
    assert np.abs(cut[..., :2] - there / 4)[inside].max() < 1.0
    assert np.abs((cut[..., :2] - there / 4)[inside].mean()) < 0.1


def test_a_body_stands_upright_in_its_crop() -> None:
    crop = about(np.array([50.0, 80.0]), np.array([90.0, 80.0]))  # it lies, its head to the right
    assert np.allclose(crop.in_picture(np.array([0.5, 0.5])), [50, 80])
    assert np.allclose(crop.in_picture(np.array([0.5, 0.5 - 0.5 / MARGIN])), [90, 80])
    assert whole(300, 200) == Crop(100.0, 150.0, 300.0, 0.0)


def people_at(*places: tuple[float, float, float]) -> Network:
    """Detects people standing at x, y (shares of the square), each by two boxes; with a logit."""

    def network(given: np.ndarray) -> list[np.ndarray]:
        assert given.shape == (224, 224, 3)
        assert given.min() >= -1
        values, logits = np.zeros((len(anchors()), 12), np.float32), np.full((2254, 1), -100.0)
        for x, y, logit in places:
            for anchor in np.argsort(np.linalg.norm(anchors() - [x, y], axis=1))[:2]:
                dx, dy = 224 * (np.array([x, y]) - anchors()[anchor])
                values[anchor] = [dx, dy, 40, 60, dx, dy, dx, dy - 50, dx, dy, dx, dy]
                logits[anchor] = logit
        return [values, logits]

    return network


def test_everybody_is_detected_once_the_most_confident_first() -> None:
    people = detect_people(
        BLACK, people_at((0.4, 0.5, 1.0), (0.6, 0.5, 3.0), (0.2, 0.2, -3.0)), 0.5
    )
    assert [round(person.confidence, 3) for person in people] == [0.953, 0.731]
    crop = people[0].crop  # the square of 300 pixels begins 50 pixels left of the picture
    assert np.allclose([crop.x, crop.y, crop.angle], [0.6 * 300 - 50, 150, 0], atol=1e-4)
    assert np.isclose(crop.side, 2 * MARGIN * 50 / 224 * 300)
    assert detect_people(BLACK, people_at(), 0.5) == []


def body(presence: float = 1.0, visibility: float = 5.0, dx: float = 0.0) -> Network:
    """A body whose points lie on a line, `dx` pixels of the crop from its middle."""

    def network(given: np.ndarray) -> list[np.ndarray]:
        assert given.shape == (256, 256, 3)
        rows = np.zeros((POINTS, 5), np.float32)
        rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3] = 128 + dx, 128, 16, visibility
        rows[:, 1] += np.arange(POINTS)
        rows[33, 1], rows[34, 1] = 128, 128 - 256 * 0.5 / MARGIN
        world = np.tile(np.float32([0.1, 0.2, 0.3]), POINTS)
        return [rows.ravel(), np.float32([presence]), np.zeros(1), COLD, world]

    return network


def test_landmarks_turn_with_the_crop() -> None:
    crop = Crop(100.0, 120.0, 128.0, math.pi / 2)  # the head points to the right
    answer = detect_landmarks(BLACK, crop, body())
    assert np.allclose(answer.xy_px[:, 0], 100 - np.arange(33) / 2)
    assert np.allclose(answer.xy_px[:, 1], 120)
    assert np.allclose(answer.z_px, 16 / 256 * 128)
    assert np.allclose(answer.world_m, [-0.2, 0.1, 0.3])
    assert np.allclose(answer.visibility, 1 / (1 + math.exp(-5)))
    assert is_same(answer.next_crop, crop)


def test_a_point_moves_to_the_heat_near_it() -> None:
    heat = np.full((64, 64, 3), -20.0)
    heat[30, 41, 0] = heat[30, 42, 0] = 6.0
    heat[50, 41, 1] = 6.0  # too far away
    points = np.array([[0.66, 0.5], [0.66, 0.5], [1.4, 0.5]])
    moved = refined(points, heat)
    assert np.allclose(moved[0], [41.5 / 64, 30 / 64], atol=1e-6)
    assert np.allclose(moved[1:], points[1:])


def test_a_person_is_followed_while_the_detector_sees_nobody() -> None:
    people = [people_at((0.5, 0.5, 3.0)), people_at(), people_at()]
    course = Course(lambda given: people.pop(0)(given), body(dx=4.0), 0.5, 0.5)
    places = [answer.xy_px[0, 0] for _ in range(3) if (answer := course.next_body(BLACK))]
    assert np.allclose(np.diff(places), np.diff(places)[0], rtol=1e-3)
    assert places[1] > places[0]


def test_nobody_is_nobody_and_a_lost_person_is_searched_for() -> None:
    assert Course(people_at(), body(), 0.5, 0.5).next_body(BLACK) is None
    presences = [0.9, 0.2, 0.9]
    people = [people_at((0.5, 0.5, 3.0)), people_at(), people_at((0.3, 0.5, 3.0))]
    course = Course(
        lambda given: people.pop(0)(given), lambda given: body(presences.pop(0))(given), 0.5, 0.5
    )
    answers = [course.next_body(BLACK) for _ in range(3)]
    assert answers[1] is None
    assert answers[0] is not None
    assert answers[2] is not None
    assert answers[2].xy_px[0, 0] == pytest.approx(answers[0].xy_px[0, 0] - 60, abs=0.1)


def test_where_two_crops_differ_the_better_body_is_taken() -> None:
    people = [people_at((0.3, 0.5, 3.0)), people_at((0.7, 0.5, 3.0))]
    visibilities = [5.0, -1.0, 5.0]
    course = Course(
        lambda given: people.pop(0)(given),
        lambda given: body(visibility=visibilities.pop(0))(given),
        0.5,
        0.5,
    )
    first, second = course.next_body(BLACK), course.next_body(BLACK)
    assert first is not None
    assert second is not None
    assert second.xy_px[0, 0] == pytest.approx(first.xy_px[0, 0] + 120, abs=0.1)

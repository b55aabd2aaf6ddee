"""Keypoints of another version of a video are read as such, by their numbers and the pictures."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from imocap_core.adapters.keypoint_reading import Reading, reading_of
from imocap_core.body.layouts import layout_names
from imocap_core.conventions import mirror_indices
from imocap_core.io.readers.people import DetectedPeople, between_people
from imocap_core.io.video import probe
from tests.io.made_film import COUNT, WIDTH, film, joints

LAYOUT = "coco17"
TWINS = list(mirror_indices(layout_names(LAYOUT)))


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return film(tmp_path_factory.mktemp("film") / "a.mp4")


def detected(
    time: np.ndarray, numbers: np.ndarray | None = None, scale: float = 1.0
) -> DetectedPeople:
    xy = scale * joints(time)
    people = np.concatenate([xy, np.full((*xy.shape[:2], 1), 0.9)], axis=-1)[:, None]
    return DetectedPeople(np.arange(len(time)) if numbers is None else numbers, tuple(people))


def read(given: DetectedPeople, clip: Path, **known: object) -> tuple[Reading, np.ndarray]:
    """The reading, and the pixels (T, 17, 2) of the video's frames."""
    info = probe(clip)
    reading = reading_of(given, info, clip, Path("k"), **known)  # type: ignore[arg-type]
    people = reading.read(given, info.frame_count, LAYOUT)
    of = dict(zip(people.frames.tolist(), people.people, strict=True))
    nobody = np.full((1, 17, 3), np.nan)
    rows = [of[t] if t in of and len(of[t]) else nobody for t in range(info.frame_count)]
    return reading, np.concatenate(rows)[..., :2]


FRAMES = np.arange(COUNT)


@pytest.mark.parametrize("scale", [0.5, 2 / 3, 2.0])
def test_keypoints_of_a_copy_of_another_size(clip: Path, scale: float) -> None:
    reading, xy = read(detected(FRAMES, scale=scale), clip)
    assert np.allclose(xy, joints(FRAMES))
    assert reading.words == (f"the keypoints are of a copy of {scale:.3g} times the size",)


def test_somebody_small_in_a_corner_stays_there(tmp_path: Path) -> None:
    """What reaches half of the picture is of a small copy only where the pictures say so."""
    given = detected(FRAMES, scale=0.5)
    still = DetectedPeople(given.frames, tuple(given.people[0] for _ in given.people))
    reading, _ = read(still, film(tmp_path / "a.mp4"))
    assert reading == Reading()  # nothing moves: nothing can be told


@pytest.mark.parametrize("rate", [Fraction(1, 2), Fraction(3, 2), Fraction(2), Fraction(4, 5)])
@pytest.mark.parametrize("first", [0, 1])
def test_keypoints_at_another_rate(clip: Path, rate: Fraction, first: int) -> None:
    time = np.arange(int(COUNT * rate)) / float(rate)
    reading, xy = read(detected(time, np.arange(len(time)) + first), clip)
    assert reading.rate == rate
    assert f"{len(time)} frames and the video has 60" in " ".join(reading.words)
    assert np.nanmax(np.abs(xy - joints(FRAMES))) < 1.5  # straight between two


@pytest.mark.parametrize(("step", "first"), [(2, 0), (3, 0), (2, 1)])
def test_every_second_or_third_frame_under_its_number(clip: Path, step: int, first: int) -> None:
    time = FRAMES[::step]
    time = np.delete(time, 5)  # nobody was detected there
    reading, xy = read(detected(time, time + first), clip)
    assert reading.words[-1] == (
        f"the keypoints are of every {'2nd' if step == 2 else '3rd'} frame: the others are between "
        "these"
    )
    assert np.allclose(xy[time], joints(time))
    assert np.max(np.abs(xy - joints(FRAMES))[: 4 * step]) < 1.5  # straight between two


def test_only_the_used_part_was_detected(clip: Path) -> None:
    reading, xy = read(detected(FRAMES[20:50], np.arange(30)), clip, used=(20, 50))
    assert np.allclose(xy[20:50], joints(FRAMES[20:50]))
    assert reading.words == ("the keypoints are numbered from frame 20 on",)


def test_pixels_that_are_not_square(tmp_path: Path) -> None:
    path = film(tmp_path / "a.mp4", aspect=Fraction(4, 3))
    shown = probe(path).display
    expected = shown.shown_points(joints(FRAMES))
    assert read(detected(FRAMES), path)[1] == pytest.approx(expected)
    square = DetectedPeople(
        FRAMES, tuple(np.concatenate([e, np.full((17, 1), 0.9)], axis=1)[None] for e in expected)
    )
    assert read(square, path)[1] == pytest.approx(expected)


def test_a_flipped_picture_and_keypoints_of_what_is_stored(tmp_path: Path) -> None:
    path = film(tmp_path / "a.mp4", flip=True)
    expected = joints(FRAMES)
    expected[..., 0] = WIDTH - 1 - expected[..., 0]
    reading, xy = read(detected(FRAMES), path)
    assert reading.mirrored
    assert np.allclose(xy, expected[:, TWINS])  # the mirror image's left is the person's right


def test_people_between_two_frames() -> None:
    rng = np.random.default_rng(2)
    a = np.concatenate([rng.uniform(0, 100, (2, 5, 2)), np.full((2, 5, 1), 0.5)], axis=-1)
    a[1, :, 0] += 500
    b = a[::-1] + (10.0, 0, 0)
    nobody = a[:0]
    between = between_people({3: a, 4: b}, 3.25, nobody)
    assert np.allclose(between, a + (2.5, 0, 0))
    assert np.array_equal(between_people({3: a}, 3.25, nobody), a)
    assert len(between_people({3: a}, 3.75, nobody)) == 0
    assert np.array_equal(between_people({3: a, 4: b}, 3.0, nobody), a)

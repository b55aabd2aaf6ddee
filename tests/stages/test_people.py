"""Who performs: the user's word, then the score, then what the other videos show."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from imocap_core.adapters.tracked_people import TrackedVideo, choose_performers, track_people
from imocap_core.body import load_free_body
from imocap_core.motion.prior import load_pose_prior
from imocap_core.params import KeypointsParams
from imocap_core.pipeline.action import Person
from imocap_core.rotations import exp

SIZE, FPS, FRAMES = (1280, 720), 30.0, 60
PARAMS = KeypointsParams(
    min_confidence=0.05, max_gap_s=1.0, looks=True, performer="agreement", sides="leave"
)
FILE = Path("actions/made/action.yaml")


def figure(seed: int, azimuth: float, x_px: float, height_px: float) -> np.ndarray:
    """(T, 17, 3): a body that goes from one pose of the prior to another and back, as filmed."""
    import torch

    model = load_free_body()
    ends = load_pose_prior().sample(2, np.random.default_rng(seed), 1.0)
    share = (0.5 - 0.5 * np.cos(np.linspace(0, 4 * np.pi, FRAMES)))[:, None]
    theta = torch.as_tensor((1 - share) * ends[0] + share * ends[1]).reshape(FRAMES, 23, 3)
    root = torch.tensor([0.0, azimuth, 0.0], dtype=torch.float64).expand(FRAMES, 1, 3)
    posed = model.shape(theta.new_zeros(1, 10)).pose(
        exp(torch.cat([root, theta], 1)), theta.new_zeros(FRAMES, 3)
    )
    points = posed.keypoints(model.points("coco17")).numpy()
    xy = points[..., :2] * (1, -1) * height_px / 1.7 + (x_px, 360)
    return np.concatenate([xy, np.full((FRAMES, 17, 1), 0.9)], -1)


def tracked(name: str, *figures: np.ndarray, person: Person | None = None) -> TrackedVideo:
    people = [np.stack([f[t] for f in figures]) for t in range(FRAMES)]
    detected = TrackedVideo(
        name, people, np.arange(FRAMES), SIZE, FPS, "coco17", 1280.0, [], person
    )
    return track_people(detected, None, PARAMS)


def middle_x(xy_px: np.ndarray) -> float:
    return float(np.nanmedian(xy_px[..., 0]))


STRANGER = figure(5, 0.4, 300, 520)
PERFORMER = figure(1, 0.0, 900, 400)
OTHERS = [tracked("v2", figure(1, 1.0, 600, 400)), tracked("v3", figure(1, -1.2, 500, 450))]


def test_the_score_alone_takes_the_larger_one() -> None:
    params = replace(PARAMS, performer="score")
    performers = choose_performers([tracked("v1", STRANGER, PERFORMER), *OTHERS], FILE, params)
    assert middle_x(performers[0].xy_px) < 500


def test_the_other_videos_tell_who_performs() -> None:
    performers = choose_performers([tracked("v1", STRANGER, PERFORMER), *OTHERS], FILE, PARAMS)
    assert middle_x(performers[0].xy_px) > 700
    assert "its motion agrees with the other videos" in performers[0].note
    assert "instead of track 1" not in performers[1].note


def test_nobody_there_is_one_sentence() -> None:
    first = tracked("v1", STRANGER, person=Person(frame=10, at=(1200, 20)))
    with pytest.raises(ValueError, match=r"videos\.v1\.person: expected a person at") as caught:
        choose_performers([first, *OTHERS], FILE, PARAMS)
    assert str(FILE) in str(caught.value)
    assert "imocap people" in str(caught.value)


def test_frames_count_as_in_the_file() -> None:
    """`frame` is a source frame, also where the used frames begin later."""
    late = replace(tracked("v1", STRANGER, PERFORMER), frames=np.arange(100, 100 + FRAMES))
    named = replace(late, person=Person(frame=110, at=(900, 360)))
    performers = choose_performers([named], FILE, PARAMS)
    assert middle_x(performers[0].xy_px) > 700


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "expected one of track, at, box, got nothing"),
        ({"track": 1, "at": (3, 4), "frame": 0}, "got track and at"),
        ({"at": (3, 4)}, "expected with at and box, and not with track; got none"),
        ({"track": 1, "frame": 3}, "got frame and track"),
        ({"frame": 0, "box": (5, 5, 3, 9)}, "x0 < x1"),
    ],
)
def test_a_person_is_named_in_one_way(given: dict[str, object], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        Person.model_validate(given)


@pytest.mark.parametrize(
    ("sides", "layouts", "repaired"),
    [
        ("leave", ("coco17",), False), ("repair", ("mediapipe33",), True),
        ("auto", ("mediapipe33",), False), ("auto", ("coco17",), True),
    ],
)  # fmt: skip
def test_sides_are_put_back_when_asked_for_and_for_detectors_that_swap_them(
    sides, layouts, repaired, monkeypatch
):
    monkeypatch.setattr("imocap_core.adapters.tracked_people.SWAPPING_LAYOUTS", layouts)
    wrong = PERFORMER.copy()
    for left, right in ((11, 12), (13, 14), (15, 16)):
        wrong[30:33, left], wrong[30:33, right] = PERFORMER[30:33, right], PERFORMER[30:33, left]
    (chosen,) = choose_performers([tracked("v1", wrong)], FILE, replace(PARAMS, sides=sides))
    np.testing.assert_allclose(chosen.xy_px, (PERFORMER if repaired else wrong)[..., :2])
    assert ("put back in 3 frames" in chosen.note) == repaired


def test_every_selection_follows_its_own_person() -> None:
    """Three people in one picture, one of whom walks past the others; each chosen by a point or a
    box, in any frame, is the performer throughout."""
    walk = figure(3, 0.0, 0, 420)
    walk[..., 0] += np.linspace(150, 1150, FRAMES)[:, None]
    people = {"left": figure(1, 0.0, 380, 300), "right": figure(5, 0.4, 860, 330), "walker": walk}
    video = tracked("v1", *people.values())
    for name, pose in people.items():
        for frame in (2, FRAMES - 3):
            low, high = pose[frame, :, :2].min(axis=0), pose[frame, :, :2].max(axis=0)
            selections = (
                Person(frame=frame, at=tuple(low / 2 + high / 2)),
                Person(frame=frame, box=(*low, *high)),
            )
            for person in selections:
                chosen = choose_performers([replace(video, person=person)], FILE, PARAMS)[0]
                assert chosen.presence == 1.0, name
                np.testing.assert_allclose(chosen.xy_px, pose[..., :2], err_msg=name)

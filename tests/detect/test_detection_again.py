"""A second look at pictures in which the place of the person is known."""

from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from imocap_core.body import load_free_body
from imocap_core.detect.detection import detect_video, is_set_up
from imocap_core.detect.detection_again import KnownPlaces, look_again
from imocap_core.detect.detectors import Detector, detector_of
from imocap_core.detect.environment import python_for
from imocap_core.detect.workers.blazepose.landmarks import MARGIN, Crop
from imocap_core.detect.workers.blazepose.looks import KINDS, RIM
from imocap_core.detect.workers.blazepose.movenet import APART, LEAST_HEAT, PEAKS, peaks_of
from imocap_core.io.readers.mediapipe import read_mediapipe
from imocap_core.io.video import write_h264
from imocap_core.pipeline.make_demo import demo_body
from imocap_core.pipeline.source import PROJECT, closure
from imocap_core.synthetic.yoga_clip import SIZE, DemoClip, make_yoga_clip, pictures
from tests.detect.conftest import clip
from tests.detect.test_blazepose import REAL, made_runtime
from tests.detect.test_detection import params

__all__ = ["made_runtime"]  # a fixture
FRAMES = 6
NAMES = load_free_body().points("body25").names


def rendered(name: str, folder: Path) -> tuple[Detector, DemoClip, Path, Path]:
    """A detector, a rendered body, its film, and what is detected in some of its frames."""
    detector = detector_of(params(detector=name), folder)
    if not is_set_up(detector):
        pytest.skip(f"not set up: imocap detect --setup --set detect.detector={name}")
    shaped, python = demo_body(7), python_for(detector.packages, print)
    take = make_yoga_clip(7, 0, shaped)
    video, file = folder / "v1.mp4", folder / "detections.npz"
    write_h264(video, islice(pictures(take, 7, 0, shaped), FRAMES), take.fps)
    detect_video(video, file, detector, python, lambda share, what: None)
    return detector, take, video, file


def upright(hips: tuple[float, float], reach_px: float) -> np.ndarray:
    """33 points: hips in one place, shoulders above, and the farthest so far away."""
    points = np.tile(hips, (33, 1)).astype(float)
    points[[11, 12], 1] -= 0.5 * reach_px
    points[0, 1] -= reach_px
    return points


def test_each_picture_is_cropped_about_its_own_place(tmp_path: Path, made_runtime: Path) -> None:
    """The stand-in sees every point in its middle, a quarter of the side from the top."""
    video = clip(tmp_path / "bar.mp4", [20, None, 22, 24])
    hips, reach = [(30.0, 30.0), (28.0, 20.0)], [10.0, 8.0]
    places = np.stack([upright(h, r) for h, r in zip(hips, reach, strict=True)])
    shares: list[float] = []
    ((first, last),) = look_again(
        [KnownPlaces(video, np.array([1, 3]), places)], REAL, made_runtime, shares.append
    )
    assert (first.presence, last.presence) == (0.0, 1.0)  # the first picture is black
    assert shares == [0.5, 1.0]
    for look, (x, y), r in zip((first, last), hips, reach, strict=True):
        expected = np.array([x, y - 0.25 * 2 * MARGIN * RIM * r])
        np.testing.assert_allclose(look.body[:, :2], np.tile(expected, (33, 1)), atol=1e-6)
        assert {kind: limb.shape for kind, limb in look.limbs_px.items()} == dict.fromkeys(
            KINDS, (2, 2)
        )


def test_the_rendered_body_is_seen_again_from_a_place_that_is_a_little_off(tmp_path: Path) -> None:
    detector, take, video, file = rendered("blazepose", tmp_path)
    frames = np.array([1, 4])
    people = read_mediapipe(file, "blazepose33", SIZE).people
    height_px = np.ptp(take.xy_px[0, :, 1])
    places = np.stack([people[k][0][:, :2] for k in frames]) + 0.03 * height_px
    python = python_for(detector.packages, print)
    (looks,) = look_again([KnownPlaces(video, frames, places)], detector, python, lambda _: None)
    for frame, look in zip(frames, looks, strict=True):
        assert look.presence > 0.9
        for kind, limbs in look.limbs_px.items():
            assert len(limbs) >= 4  # both sides, both networks
            for side in ("left", "right"):
                true_px = take.xy_px[frame, NAMES.index(f"{side}_{kind}")]
                assert np.linalg.norm(limbs - true_px, axis=1).min() < 0.04 * height_px


def test_peaks_are_the_places_of_highest_heat_that_lie_apart() -> None:
    heat = np.full((64, 64, 17), -9.0, np.float32)
    heat[10, 20, 3], heat[11, 21, 3], heat[40, 50, 3] = 2.0, 1.5, 3.0
    heat[30, 30, 4] = np.log(LEAST_HEAT / (1 - LEAST_HEAT)) - 0.1
    heat[5 : 5 + 2 * APART * (PEAKS + 1) : 2 * APART, 7, 5] = 1.0
    offset = np.zeros((64, 64, 34), np.float32)
    offset[40, 50, 2 * 3 : 2 * 3 + 2] = 0.25, 0.5  # down, right
    peaks = peaks_of([heat, heat[..., :1], offset, offset], Crop(32.0, 32.0, 64.0, 0.0))
    np.testing.assert_allclose(peaks[3], [[50.5, 40.25], [20.0, 10.0]])
    assert [len(peaks[k]) for k in (4, 5, 6)] == [0, PEAKS, 0]


def test_a_second_look_depends_on_the_code_that_looks() -> None:
    depends = closure(PROJECT / "stages" / "redetect.py")
    workers = "imocap_core.detect.workers"
    beside = {f"{workers}.{name}" for name in ("blazepose_again", "blazepose_pose", "exchange")}
    inside = {f"{workers}.blazepose.{n}" for n in ("looks", "landmarks", "movenet")}
    assert beside | inside <= set(depends)


JOINTS = {"left_shoulder": 11, "right_shoulder": 12, "left_hip": 23, "left_knee": 25}


@pytest.mark.parametrize("name", ["mediapipe", "blazepose"])
def test_it_finds_the_rendered_body_where_it_is(tmp_path: Path, name: str) -> None:
    _, take, _, file = rendered(name, tmp_path)
    detections = read_mediapipe(file, "mediapipe33", SIZE)
    assert [len(people) for people in detections.people] == [1] * FRAMES
    height_px = np.ptp(take.xy_px[0, :, 1])
    for joint, point in JOINTS.items():
        true_px = take.xy_px[FRAMES - 1, NAMES.index(joint)]
        point_px = detections.people[-1][0, point]
        assert np.linalg.norm(point_px[:2] - true_px) < 0.06 * height_px, joint
        assert point_px[2] > 0.5, joint

"""The detectors themselves, where they have been set up: they find the rendered free body."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from imocap_core.detect.detection import detect_video, is_set_up
from imocap_core.detect.detectors import detector_of
from imocap_core.detect.environment import python_for
from imocap_core.io.readers.mediapipe import read_mediapipe
from imocap_core.io.video import write_h264
from imocap_core.pipeline.make_demo import demo_body
from imocap_core.synthetic.yoga_clip import SIZE, make_yoga_clip, pictures
from tests.detect.test_detection import params

FRAMES = 6
JOINTS = {"left_shoulder": 11, "right_shoulder": 12, "left_hip": 23, "left_knee": 25}


@pytest.mark.parametrize("name", ["mediapipe", "blazepose"])
def test_it_finds_the_rendered_body_where_it_is(tmp_path: Path, name: str) -> None:
    detector = detector_of(params(detector=name), tmp_path)
    if not is_set_up(detector):
        pytest.skip(f"not set up: imocap detect --setup --set detect.detector={name}")
    python = python_for(detector.packages, print)
    shaped = demo_body(7)
    take = make_yoga_clip(7, 0, shaped)
    video, file = tmp_path / "v1.mp4", tmp_path / "detections.npz"
    write_h264(video, islice(pictures(take, 7, 0, shaped), FRAMES), take.fps)
    detect_video(video, file, detector, python, lambda share, what: None)
    detections = read_mediapipe(file, "mediapipe33", SIZE)
    assert [len(people) for people in detections.people] == [1] * FRAMES
    height_px = np.ptp(take.xy_px[0, :, 1])
    names = shaped.model.points("body25").names
    for name, point in JOINTS.items():
        true_px = take.xy_px[FRAMES - 1, names.index(name)]
        point_px = detections.people[-1][0, point]
        assert np.linalg.norm(point_px[:2] - true_px) < 0.06 * height_px, name
        assert point_px[2] > 0.5, name

"""The performer's keypoints keep what was detected beside the corrected marks."""

import numpy as np
import pytest

from imocap_core.adapters.detected_people import with_corrected_marks
from imocap_core.artifacts.schemas import VideoKeypoints
from imocap_core.body.layouts import layout_names
from tests.made_keypoints import made_keypoints

FRAMES = 5


def keypoints(layout: str) -> VideoKeypoints:
    count = len(layout_names(layout))
    xy_px = np.random.default_rng(0).uniform(100.0, 300.0, (FRAMES, count, 2))
    confidence = np.ones((FRAMES, count))
    return made_keypoints(np.arange(FRAMES), layout, xy_px=xy_px, confidence=confidence)


@pytest.mark.parametrize("layout", ["body25", "mediapipe33"])
def test_layouts_without_a_correction_stay_as_they_are(layout: str) -> None:
    detected = keypoints(layout)
    assert with_corrected_marks(detected) is detected
    np.testing.assert_array_equal(detected.marks_px, detected.xy_px)


def test_detections_stay_beside_the_corrected_marks() -> None:
    detected = keypoints("blazepose33")
    corrected = with_corrected_marks(detected)
    np.testing.assert_array_equal(corrected.xy_px, detected.xy_px)
    moved = np.any(corrected.marks_px != corrected.xy_px, axis=(0, 2))
    names = [name for name, m in zip(layout_names("blazepose33"), moved, strict=True) if m]
    assert sorted(names) == ["left_hip", "left_shoulder", "right_hip", "right_shoulder"]

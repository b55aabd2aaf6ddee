"""Outlines enclose the person: every joint lies in the polygon, and little else does."""

import cv2
import numpy as np
import pytest

from imocap_core.body.layouts import layout_names
from imocap_core.pick.media import outline
from tests.stages.test_people import PERFORMER, tracked

COCO = layout_names("coco17")


@pytest.mark.parametrize("frame", [0, 17, 31])
@pytest.mark.parametrize("scale", [1.0, 0.05])
def test_every_joint_is_inside(frame: int, scale: float) -> None:
    pose = PERFORMER[frame] * (scale, scale, 1)
    polygon = outline(pose, COCO).astype(np.float32)
    size = float(np.hypot(*np.ptp(pose[:, :2], axis=0)))
    for x, y, _ in pose:
        assert cv2.pointPolygonTest(polygon, (float(x), float(y)), True) > -0.03 * size
    assert cv2.contourArea(polygon) < 0.8 * np.prod(np.ptp(polygon, axis=0))


def test_joints_that_are_missing_leave_one_polygon() -> None:
    pose = PERFORMER[5].copy()
    pose[[5, 6, 7, 11], 2] = 0  # shoulders, an elbow, a hip
    polygon = outline(pose, COCO).astype(np.float32)
    for x, y in pose[pose[:, 2] > 0, :2]:
        assert cv2.pointPolygonTest(polygon, (float(x), float(y)), True) > -12


def test_frames_are_those_of_the_file() -> None:
    from dataclasses import replace

    from imocap_core.pick.media import outlines_of

    video = tracked("v1", PERFORMER)
    late = outlines_of(replace(video, frames=video.frames + 100))
    (person,) = late["people"]
    assert late["frames"] == [100, 160]
    assert person["frames"][0] == 100
    assert len(person["boxes"][0]) == 4
    assert len(person["outlines"]) == len(person["frames"])

"""A corrected lens is in the table of videos and among the remarks; without one nothing is said."""

from __future__ import annotations

import numpy as np
import pytest

from imocap_core.adapters.lenses import lens_words, lenses_of
from imocap_core.artifacts.schemas import CameraMotion, LensDistortion
from imocap_core.diagnostics.detection_findings import camera_findings
from imocap_core.report.tables import video_table
from tests.report.made import SIZE, K, Made


def with_lens(made: Made) -> CameraMotion:
    lens = LensDistortion(source="rotation", coefficients=np.array([-0.2, 0, 0, 0, 0]), k1_sd=0.01)
    first, *others = made.camera_motion.videos
    note = f"turns by up to 9.0 degrees; {lens_words(lens, SIZE, K)}"
    bent = first.model_copy(update={"lens": lens, "note": note})
    return CameraMotion(videos=[bent, *others])


def test_the_table_of_videos(made: Made) -> None:
    cameras = with_lens(made)
    table = video_table(made.keypoints, cameras, made.refined)
    column = table.columns.index("lens_k1")
    assert [row[column] for row in table.rows] == [-0.2, *[None] * (len(table.rows) - 1)]
    plain = video_table(made.keypoints, made.camera_motion, made.refined)
    assert "lens_k1" not in plain.columns
    assert {len(row) for row in plain.rows} == {len(plain.columns)}


def test_the_remark(made: Made) -> None:
    (remark,) = camera_findings(with_lens(made).videos)
    assert (remark.kind, remark.video) == ("remark", made.camera_motion.videos[0].id)
    assert remark.text.startswith(
        "its lens was estimated from its turning and is corrected (k1 -0.200 +- 0.010, "
    )
    assert camera_findings(made.camera_motion.videos) == []


def test_lenses_by_video(made: Made) -> None:
    lenses = lenses_of(with_lens(made), None)
    assert list(lenses) == [made.camera_motion.videos[0].id]
    assert next(iter(lenses.values())).coefficients[0] == pytest.approx(-0.2)
    assert lenses_of(made.camera_motion, None) == {}

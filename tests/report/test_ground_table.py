"""The report's table of the ground, for cameras of known height and tilt."""

from __future__ import annotations

import numpy as np
import pytest

from imocap_core.artifacts.schemas import GroundPlane
from imocap_core.report.tables import ground_tables
from tests.report.made import Made


def test_without_a_ground_there_is_no_table() -> None:
    made = Made()
    assert ground_tables(made.initial, made.camera_motion, made.refined) == []


def test_cameras_above_a_ground() -> None:
    made = Made()
    pitch = np.radians(10.0)
    up = np.array([0.0, -np.cos(pitch), -np.sin(pitch)])
    sole = made.refined.motion.videos[0].joints[:, [10, 11]] @ up
    origin = (sole.min() + 0.013) * up  # balls of the feet 27 mm above soles, 40 mm below
    plane = GroundPlane(up=up, origin=origin, tilt_sd_deg=2.0, height_sd_mm=12.0)
    motion = made.refined.motion.model_copy(update={"ground": plane})
    refined = made.refined.model_copy(update={"motion": motion})
    initial = made.initial.model_copy(update={"grounds": [plane] * 3})
    (table,) = ground_tables(initial, made.camera_motion, refined)
    row = dict(zip(table.columns, table.rows[0], strict=True))
    assert row["pitch_down_deg"] == pytest.approx(10.0)
    assert row["roll_deg"] == pytest.approx(0.0)
    assert row["camera_height_m"] == pytest.approx(-origin @ up)
    assert 0 < row["sole_depth_mm"] <= 40.0 + 1e-6
    assert row["up_alone_deg"] == pytest.approx(0.0, abs=1e-5)
    assert "2.0 degrees" in table.note

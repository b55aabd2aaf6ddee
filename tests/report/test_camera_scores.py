"""Rows of the cameras' errors: values where the truth has them, else the reason."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.artifacts.schemas import Camera, SyncSummary
from imocap_core.evaluate.scoreboard import FOCAL, PLACE, ROTATION, camera_rows
from imocap_core.io.truth import Truth, VideoTruth

IDS = ("v1", "v2", "v3", "v4")
K = np.array([[600.0, 0, 320], [0, 600, 180], [0, 0, 1]])
R = Rotation.random(4, random_state=0).as_matrix()
T = np.random.default_rng(0).normal(size=(4, 3))
WORLD = Rotation.random(random_state=1).as_matrix()  # the result's axes from the truth's
TRUTH = Truth(
    {
        i: VideoTruth(joints=None, joint_names=(), K=K, R=R_, t=t, phase=None)
        for i, R_, t in zip(IDS, R, T, strict=True)
    },
    phase_end=1.0,
)
CAMERAS = [  # of another size, with axes and an origin of its own
    Camera(id=i, K=K * [[1.02], [1.02], [1]], R=R_ @ WORLD.T, t=0.7 * t + R_ @ [1.0, 2.0, 3.0])
    for i, R_, t in zip(IDS, R, T, strict=True)
]


def values(cameras: list[Camera], truth: Truth | None, **sync: list[str]) -> dict:  # type: ignore[type-arg]
    summary = SyncSummary.model_construct(
        reference="v1", **({"excluded": [], "mirrored": []} | sync)
    )
    rows = camera_rows("after loop", cameras, summary, truth)
    return {(row.video, row.metric): (row.value, row.note) for row in rows}


def test_places_are_scored_in_any_world_and_focal_lengths_by_their_ratio() -> None:
    found = values(CAMERAS, TRUTH)
    for i in IDS:
        assert found[i, PLACE][0] == pytest.approx(0, abs=1e-6)
        assert found[i, FOCAL][0] == pytest.approx(100 * np.log(1.02))
    assert ("v1", ROTATION) not in found  # the reference has no error by definition
    assert found["v3", ROTATION][0] == pytest.approx(0, abs=1e-4)


def test_what_is_not_scored_has_a_reason() -> None:
    two = values(CAMERAS[:2], TRUTH)
    assert two["v2", PLACE] == (None, "places are compared from 3 cameras on")
    without = replace(TRUTH, videos={i: replace(v, t=None) for i, v in TRUTH.videos.items()})
    for truth in (None, without):
        assert values(CAMERAS, truth)["v2", PLACE] == (None, "the true cameras are not known")
    left_out = values(CAMERAS, TRUTH, excluded=["v4"])
    assert left_out["v4", ROTATION] == (None, "excluded")
    assert ("v4", PLACE) not in left_out
    assert left_out["v2", PLACE][0] == pytest.approx(0, abs=1e-6)

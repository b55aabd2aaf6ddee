"""Human3.6M's files become actions: cameras found again, detections untouched."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.actions import h36m
from benchmarks.actions.choice import Choice
from benchmarks.actions.h36m_files import H36M_17
from benchmarks.actions.prepare import chosen_names
from benchmarks.synthetic.captured import CAMERA_PLACEMENTS, COCO18, place_camera
from imocap_core.camera.projection import project
from imocap_core.conventions import EVAL_12, EVAL_14, EVAL_17
from imocap_core.errors import WorkFailed, WrongUse
from tests.benchmarks.test_captured import figure
from tests.benchmarks.test_h36m_files import write_h36m

FRAMES = 320


def walking() -> np.ndarray:
    """(T, 17, 3): the figure on a round through the room."""
    turn = np.linspace(0, 6, FRAMES)
    joints = np.zeros((FRAMES, 17, 3))
    moved = (
        figure(FRAMES, seed=1)
        + np.stack([1.5 * np.cos(turn), 1.5 * np.sin(turn), 0 * turn], -1)[:, None]
    )
    for k, name in enumerate(EVAL_14):
        joints[:, H36M_17.index(name)] = moved[:, k]
    return joints


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    where = tmp_path_factory.mktemp("h36m")
    joints = walking()
    rng = np.random.default_rng(0)
    views = []
    for view in CAMERA_PLACEMENTS:
        K, R, t = place_camera(view, joints[:, [H36M_17.index(n) for n in EVAL_14]], (1000, 1002))
        xy = project(joints.reshape(-1, 3), K, R, t).reshape(FRAMES, 17, 2)
        views.append((xy + rng.normal(0, 3, xy.shape)).astype(np.float32))
    actions = {"Photo 1": joints.astype(np.float32), "Walking": joints.astype(np.float32)}
    write_h36m(where, {"S9": actions}, {"S9": dict.fromkeys(actions, views)})
    return where


def test_only_the_paper_s_actions_are_used(folder: Path) -> None:
    choice = Choice("h36m", data=folder)
    assert chosen_names(folder, choice) == ["S9_Photo_1"]
    with pytest.raises(WrongUse, match="--only S9_Walking: expected one of S9_Photo_1"):
        chosen_names(folder, Choice("h36m", only=("S9_Walking",), data=folder))


def test_cameras_are_found_from_the_pairs(folder: Path) -> None:
    shots = h36m.h36m_videos(Choice("h36m", data=folder, videos=2), "S9_Photo_1")
    joints = walking()[:, [H36M_17.index(n) for n in EVAL_14]]
    for view, shot in zip(CAMERA_PLACEMENTS, shots, strict=False):
        K, R, _ = place_camera(view, joints, (1000, 1002))
        assert shot.recorded is not None
        assert shot.recorded.K[0, 0] == pytest.approx(K[0, 0], rel=0.02)
        assert np.arccos((np.trace(shot.recorded.R @ R.T) - 1) / 2) < np.radians(0.7)
        assert shot.recorded.xy_px.shape == (FRAMES, 18, 2)
        assert (shot.joints_m, shot.fps) == (pytest.approx(joints, abs=1e-5), 50.0)
    assert len(shots[0].frames) == 150
    truth = shots[0].truth("v1", np.eye(3), np.eye(3), np.zeros(3))
    assert truth["v1/joints"].shape == (150, 17, 3)
    assert set(EVAL_17) <= set(shots[0].truth_names)


def test_detections_are_named_as_coco_names_them() -> None:
    xy = np.arange(17 * 2, dtype=float).reshape(1, 17, 2)
    coco = h36m.coco18_pixels(xy)
    for name in EVAL_12:
        if not name.endswith("hip"):
            assert (coco[0, COCO18.index(name)] == xy[0, H36M_17.index(name)]).all()
    assert np.isnan(coco[0, COCO18.index("nose")]).all()
    left, right = xy[0, H36M_17.index("left_hip")], xy[0, H36M_17.index("right_hip")]
    hips = coco[0, [COCO18.index("left_hip"), COCO18.index("right_hip")]]
    assert hips.mean(0) == pytest.approx((left + right) / 2)
    assert np.linalg.norm(hips[0] - hips[1]) == pytest.approx(1.24 * np.linalg.norm(left - right))


def test_files_that_do_not_belong_together_are_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    views = [rng.uniform(0, 1000, (FRAMES, 17, 2)) for _ in range(4)]
    write_h36m(tmp_path, {"S9": {"Photo": walking()}}, {"S9": {"Photo": views}})
    with pytest.raises(WorkFailed, match="S9, camera 1: only"):
        h36m.h36m_videos(Choice("h36m", data=tmp_path), "S9_Photo")

"""Human3.6M's files become actions: cameras found again, detections untouched."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.actions import h36m
from benchmarks.actions.captured_videos import Choice
from benchmarks.actions.h36m import FILE_3D, H36M_17, read_h36m, resect
from benchmarks.actions.prepare import chosen_names
from benchmarks.synthetic.captured import CAMERA_PLACEMENTS, COCO18, place_camera
from imocap_core.camera.projection import intrinsics, project
from imocap_core.conventions import EVAL_12, EVAL_14, EVAL_17
from imocap_core.errors import WrongUse
from imocap_core.io.array_files import read_object
from tests.benchmarks.test_synthetic import figure
from tests.io.made_keypoints import write_positions

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


def write_h36m(folder: Path, tree_3d: dict, tree_2d: dict) -> None:
    np.savez_compressed(folder / FILE_3D, positions_3d=np.array(tree_3d, dtype=object))
    write_positions(folder, tree_2d, "h36m")


def test_joints_are_the_seventeen_that_move_and_lengths_the_shorter(tmp_path: Path) -> None:
    joints = np.arange(5 * 32 * 3, dtype=np.float32).reshape(5, 32, 3)
    views = [np.full((6, 17, 2), c, np.float32) for c in range(4)]
    write_h36m(
        tmp_path,
        {"S9": {"Photo": joints, "Waiting": joints}, "S1": {"Photo": joints}},
        {"S9": {"Photo": views}},
    )
    recordings = read_h36m(tmp_path)
    assert {s: list(actions) for s, actions in recordings.items()} == {"S9": ["Photo"]}
    recording = recordings["S9"]["Photo"]
    assert recording.joints_m.shape == (5, 17, 3)
    assert recording.xy_px.shape == (4, 5, 17, 2)
    assert recording.xy_px[:, 0, 0, 0].tolist() == [0, 1, 2, 3]
    # The 32 joints' numbers: left ankle 8, head top 15, left wrist 19, right wrist 27.
    for name, of_32 in (("left_ankle", 8), ("head", 15), ("left_wrist", 19), ("right_wrist", 27)):
        assert (recording.joints_m[:, H36M_17.index(name)] == joints[:, of_32]).all()


def test_what_is_no_object_array_is_named(tmp_path: Path) -> None:
    file = tmp_path / "x.npz"
    with pytest.raises(ValueError, match="no such file"):
        read_object(file, "a")
    file.write_bytes(b"PK no zip")
    with pytest.raises(ValueError, match="is not a readable npz file"):
        read_object(file, "a")
    np.savez(file, b=np.ones(3))
    with pytest.raises(ValueError, match="expected an array of that name, the file has b"):
        read_object(file, "a")
    with pytest.raises(ValueError, match="expected one Python object"):
        read_object(file, "b")
    np.savez(file, a=np.array({"k": np.ones(1000)}, dtype=object))
    whole = file.read_bytes()
    file.write_bytes(whole[:200] + b"\0" * 60 + whole[260:])
    with pytest.raises(ValueError, match=r"readable npz file|read safely"):
        read_object(file, "a")


K = intrinsics(1145.0, (1000, 1002)) + np.array([[0, 0, 12.0], [0, 0, 14.0], [0, 0, 0]])
R = Rotation.from_euler("xyz", [100, 10, 40], degrees=True).as_matrix()
T = -R @ np.array([2.0, -4.5, 1.5])


def pairs(noise_px: float, outliers: float, count: int = 1500) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    target = np.array([2.0, -4.5, 1.5]) + R.T @ np.array([0, 0, 5.0])
    world = target + rng.uniform(-1.2, 1.2, (count, 3))
    xy = project(world, K, R, T) + rng.normal(0, noise_px, (count, 2))
    wrong = rng.random(count) < outliers
    xy[wrong] += rng.uniform(-300, 300, (wrong.sum(), 2))
    xy[:5] = np.nan
    return world, xy


def test_noise_and_outliers_move_it_little() -> None:
    estimate = resect(*pairs(5.0, 0.1), np.random.default_rng(0))
    assert estimate.ok
    turn = Rotation.from_matrix(estimate.R @ R.T).magnitude()
    assert 0 < np.degrees(turn) < 0.5
    assert estimate.K[0, 0] == pytest.approx(1145, rel=0.02)
    assert np.linalg.norm(estimate.R.T @ estimate.t - R.T @ T) < 0.08
    assert estimate.median_px == pytest.approx(5 * np.sqrt(2 * np.log(2)), abs=1.0)
    assert 0.85 < estimate.inlier_share < 0.95


def test_pairs_without_a_camera_are_said() -> None:
    world, xy = pairs(0.0, 0.0)
    estimate = resect(world, np.random.default_rng(2).permutation(xy), np.random.default_rng(0))
    assert not estimate.ok
    assert "agree with one camera" in estimate.status

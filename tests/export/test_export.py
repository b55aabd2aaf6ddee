"""export --format npz: the files that interfaces.md promises, one body in one world."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.artifacts.schemas import (
    Artifact,
    Camera,
    Hands,
    Keypoints,
    RefineSync,
    SmplBa,
    Sync,
    SyncMap,
    VideoHands,
    VideoKeypoints,
    VideoMotion,
)
from imocap_core.artifacts.store import Store
from imocap_core.camera.gravity import BALL_ABOVE_SOLE_M
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.errors import WorkFailed
from imocap_core.export.formats import export
from imocap_core.io.readers.smpl_estimators import read_smpl_npz
from imocap_core.library.result import Result
from imocap_core.pipeline.action import Action
from tests.made_keypoints import made_keypoints
from tests.made_sync import stored_matrix

LENGTHS = {"a": 30, "b": 20}
FIRST = {"a": 100, "b": 7}  # source frame numbers start there
R_B = Rotation.from_euler("y", 90, degrees=True).as_matrix()
CAMERAS = {"a": (np.eye(3), np.zeros(3)), "b": (R_B, np.array([0.0, 0.0, 4.0]))}


def frames(video: str) -> np.ndarray:
    return FIRST[video] + np.arange(LENGTHS[video])


def keypoints(video: str) -> VideoKeypoints:
    return made_keypoints(frames(video), id=video)


def motion(video: str) -> VideoMotion:
    """The same upright walk in the world of `a` (y down), seen from each camera."""
    count = LENGTHS[video]
    R, t = CAMERAS[video]
    world = np.zeros((count, 24, 3))
    world[:, :, 0] = 0.02 * np.arange(count)[:, None]
    world[..., 2] = 3.0
    height = np.array([0.9 if "foot" not in name else 0.0 for name in SMPL_JOINTS])
    world[..., 1] = 1.0 - height
    joints = world @ R.T + t
    return VideoMotion(
        id=video, frames=frames(video), theta=np.zeros((count, 72)), betas=np.zeros(10),
        trans=joints[:, 0], joints=joints, reprojection_px=np.zeros(count),
    )  # fmt: skip


def refined() -> RefineSync:
    cameras = [Camera(id=v, K=np.eye(3), R=R, t=t) for v, (R, t) in CAMERAS.items()]
    ba = SmplBa(
        reference="a", model="free_body", model_digest="d1", videos=[motion(v) for v in LENGTHS],
        cameras=cameras, objective=[1.0], misfit=1.0, status="",
    )  # fmt: skip
    at = np.arange(20.0) + 0.5
    at[3] = np.nan
    sync = Sync(
        reference="a", ids=["a", "b"], lengths=[30, 20],
        maps=[
            SyncMap(id="a", reference_frame=np.arange(30.0), confidence=np.ones(30)),
            SyncMap(id="b", reference_frame=at, confidence=np.full(20, 0.75)),
        ],
        method="als", centrality=np.ones(2), status="",
        **stored_matrix(np.zeros((50, 50)), ["a", "b"], [30, 20]),
    )  # fmt: skip
    return RefineSync(rounds=[], best=0, sync=sync, motion=ba, status="")


@pytest.fixture
def store(tmp_path: Path) -> Store:
    made = Store(tmp_path / "artifacts")
    parts: dict[str, Artifact] = {
        "keypoints": Keypoints(videos=[keypoints(v) for v in LENGTHS]),
        "refine_sync": refined(),
    }
    for stage, artifact in parts.items():
        made.publish("walk", stage, made.put(stage, "k", artifact, {}, {}))
    return made


def export_npz(store: Store, out: Path, up: str | None) -> list[Path]:
    result = Result.of_action(store, Action(Path(), "walk", ()))
    return export(result, "npz", out, up).files


def test_what_lies_there(store: Store, tmp_path: Path) -> None:
    written = export_npz(store, tmp_path / "out", None)
    assert [f.name for f in written] == [
        *("a.npz", "b.npz", "sync.csv", "cameras.json", "export_npz.json")
    ]
    shapes = {
        "poses": (20, 72),
        "betas": (10,),
        "trans": (20, 3),
        "joints": (20, 24, 3),
        "joint_names": (24,),
        "fps": (),
        "mocap_framerate": (),
        "frames": (20,),
        "K": (3, 3),
        "R": (3, 3),
        "t": (3,),
        "model": (),
        "up_axis": (),
    }
    with np.load(tmp_path / "out" / "b.npz") as data:
        assert {name: data[name].shape for name in data.files} == shapes
        assert str(data["model"]) == "free_body d1"
        assert str(data["up_axis"]) == "-y"
        assert list(data["joint_names"][:2]) == ["pelvis", "left_hip"]
        np.testing.assert_array_equal(data["frames"], frames("b"))


def test_both_videos_speak_of_one_world(store: Store, tmp_path: Path) -> None:
    export_npz(store, tmp_path, None)
    a, b = (np.load(tmp_path / f"{v}.npz") for v in LENGTHS)
    np.testing.assert_allclose(a["joints"][:20], b["joints"], atol=1e-12)
    np.testing.assert_allclose(b["joints"] @ b["R"].T + b["t"], motion("b").joints, atol=1e-12)


def test_our_own_reader_takes_it(store: Store, tmp_path: Path) -> None:
    export_npz(store, tmp_path, None)
    read = read_smpl_npz(tmp_path / "b.npz", frames("b"))
    assert read.theta.shape == (20, 72)
    np.testing.assert_array_equal(read.R, R_B)


def test_sync_speaks_in_source_frames(store: Store, tmp_path: Path) -> None:
    export_npz(store, tmp_path, None)
    with (tmp_path / "sync.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert {row["video"] for row in rows} == {"b"}
    assert len(rows) == 20
    assert rows[0] == {
        "video": "b",
        "frame": "7",
        "reference_frame": "100.500",
        "confidence": "0.750",
        "phase_s": "",
    }
    assert rows[3]["reference_frame"] == ""


def test_cameras(store: Store, tmp_path: Path) -> None:
    export_npz(store, tmp_path, None)
    content = json.loads((tmp_path / "cameras.json").read_text())
    assert content["reference"] == "a"
    assert content["cameras"]["b"]["size"] == [640, 360]
    np.testing.assert_array_equal(content["cameras"]["b"]["R"], R_B)


@pytest.mark.parametrize(("up", "axis"), [("y", 1), ("z", 2)])
def test_level_stands_on_its_ground(store: Store, tmp_path: Path, up: str, axis: int) -> None:
    export_npz(store, tmp_path, up)
    with np.load(tmp_path / "b.npz") as data:
        assert str(data["up_axis"]) == up
        names = list(data["joint_names"])
        heights = data["joints"][..., axis]
        seen = data["joints"] @ data["R"].T + data["t"]
    ball_m = BALL_ABOVE_SOLE_M
    np.testing.assert_allclose(heights[:, names.index("left_foot")], ball_m, atol=1e-6)
    np.testing.assert_allclose(heights[:, names.index("head")], 0.9 + ball_m, atol=1e-6)
    np.testing.assert_allclose(seen, motion("b").joints, atol=1e-9)


def test_what_is_missing_is_said(store: Store, tmp_path: Path) -> None:
    store.current("walk", "refine_sync").unlink()
    with pytest.raises(WorkFailed, match=r"walk has no refine_sync artifact yet; run it with"):
        export_npz(store, tmp_path, None)


def hands(video: str) -> VideoHands:
    """Hands whose wrists bend a little; their points lie along the body's wrists."""
    count = LENGTHS[video]
    points = np.repeat(motion(video).joints[:, 20:22, None], 21, axis=2)
    return VideoHands(
        id=video, frames=frames(video), fingers=np.full((count, 2, 15, 3), 0.3),
        wrists=np.full((count, 2, 3), 0.1), points_m=points,
        visible=np.ones((count, 2), dtype=np.int64),
    )  # fmt: skip


@pytest.mark.parametrize("up", [None, "y"])
def test_hands_make_it_smplh(store: Store, tmp_path: Path, up: str | None) -> None:
    found = Hands(
        videos=[hands(v) for v in LENGTHS], model="f", model_digest="d", size=1.0, status=""
    )
    store.publish("walk", "hands", store.put("hands", "k", found, {}, {}))
    export_npz(store, tmp_path, up)
    with np.load(tmp_path / "b.npz") as data:
        assert data["joints"].shape == (20, 24, 3)
        assert data["poses_smplh"].shape == (20, 156)
        np.testing.assert_array_equal(data["poses_smplh"][:, :60], data["poses"][:, :60])
        assert (data["poses_smplh"][:, 60:66] == 0.1).all()
        assert (data["poses_smplh"][:, 66:] == 0.3).all()
        np.testing.assert_allclose(
            data["hand_points"][:, :, 7], data["joints"][:, 20:22], atol=1e-12
        )
        assert data["hand_seen"].all()


def test_without_hands_nothing_is_said_of_them(store: Store, tmp_path: Path) -> None:
    none = Hands(videos=[], model="", model_digest="", size=1.0, status="")
    store.publish("walk", "hands", store.put("hands", "k", none, {}, {}))
    export_npz(store, tmp_path, None)
    with np.load(tmp_path / "a.npz") as data:
        assert not [name for name in data.files if "hand" in name or "smplh" in name]

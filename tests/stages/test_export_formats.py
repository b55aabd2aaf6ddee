"""imocap export in every format: one action, two videos, written and read back."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from imocap_core.artifacts.schemas import (
    Artifact,
    Camera,
    CameraMotion,
    Keypoints,
    RefineSync,
    SmplBa,
    Sync,
    SyncMap,
    SyncTrust,
    VideoCameraMotion,
    VideoKeypoints,
    VideoMotion,
    VideoTrust,
)
from imocap_core.artifacts.store import Store
from imocap_core.body import load_free_body
from imocap_core.body.conversions import rotations_from_pose
from imocap_core.conventions import SMPL_JOINTS
from stages.cli.export_formats import WRITERS, Exported, export, linear
from stages.cli.export_sources import read_result
from stages.cli.export_takes import camera_of
from stages.cli.export_time import on_common_time
from stages.harness.errors import WorkFailed, WrongUse

K = np.array([[600.0, 0, 320], [0, 600, 180], [0, 0, 1]])
LENGTHS = {"a": 31, "b": 21}
FPS = {"a": 30.0, "b": 20.0}
R_B = Rotation.from_euler("y", 90, degrees=True).as_matrix()
POSES = {"a": (np.eye(3), np.zeros(3)), "b": (R_B, np.array([0.0, 0.0, 4.0]))}
BETAS = np.linspace(-1, 1, 10)
# Both show one second of the same: a its whole second, b from a tenth to the end and beyond.
PHASES = {"a": np.arange(31) / 30.0, "b": 0.1 + np.arange(21) / 20.0}


def world_motion(phase_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """theta (T, 72), trans (T, 3) in the world of `a`: upright, y down; arms swing, it walks."""
    upright = Rotation.from_euler("x", 180, degrees=True)
    theta = np.zeros((len(phase_s), 24, 3))
    theta[:, 0] = upright.as_rotvec()
    theta[:, SMPL_JOINTS.index("left_shoulder"), 2] = -1.2 + 0.5 * np.sin(2 * phase_s)
    theta[:, SMPL_JOINTS.index("right_knee"), 0] = 0.4 * phase_s
    trans = np.stack([0.5 * phase_s, np.zeros(len(phase_s)), 3.0 + 0 * phase_s], axis=1)
    return theta.reshape(len(phase_s), 72), trans


def motion(video: str) -> VideoMotion:
    """What the camera of `video` saw of it."""
    theta, trans = world_motion(PHASES[video])
    R, t = POSES[video]
    root = Rotation.from_matrix(R) * Rotation.from_rotvec(theta[:, :3])
    theta = np.concatenate([root.as_rotvec(), theta[:, 3:]], axis=1)
    trans = trans @ R.T + t
    shaped = load_free_body().shape(torch.as_tensor(BETAS))
    local = rotations_from_pose(torch.as_tensor(theta))
    joints = shaped.pose(local, torch.as_tensor(trans)).joints.numpy()
    count = LENGTHS[video]
    return VideoMotion(
        id=video,
        frames=100 + np.arange(count),
        theta=theta,
        betas=BETAS,
        trans=joints[:, 0] - shaped.joints_rest[0].numpy(),
        joints=joints,
        reprojection_px=np.zeros(count),
    )


def keypoints(video: str) -> VideoKeypoints:
    count = LENGTHS[video]
    return VideoKeypoints(
        id=video, fps=FPS[video], size=(640, 360), layout="body25", video=None, focal_px=None,
        initial=None, initial_format=None, frames=100 + np.arange(count),
        xy_px=np.zeros((count, 25, 2)), confidence=np.zeros((count, 25)),
        person_box_px=np.zeros((count, 4)), tracks_found=1, presence=1.0, note="",
    )  # fmt: skip


def turned(video: str) -> VideoCameraMotion:
    """Camera `b` turns evenly about its own y axis."""
    count = LENGTHS[video]
    angles = np.linspace(0, 0.5, count) if video == "b" else np.zeros(count)
    turns = Rotation.from_rotvec(np.outer(angles, [0, 1, 0])).as_matrix()
    return VideoCameraMotion(
        id=video, K=K, focal_source="given", motion="rotating", note="", residual_px=0.0,
        H_first_from_frame=turns, R_first_from_frame=turns, inliers=np.zeros(count, dtype=np.int64),
        xy_first_px=np.zeros((count, 25, 2)),
    )  # fmt: skip


def refined(phases: dict[str, np.ndarray] | None) -> RefineSync:
    body = load_free_body()
    ba = SmplBa(
        reference="a", model=body.name, model_digest=body.digest,
        videos=[motion(v) for v in LENGTHS],
        cameras=[Camera(id=v, K=K, R=R, t=t) for v, (R, t) in POSES.items()],
        objective=[1.0], misfit=1.0, status="",
    )  # fmt: skip
    trust = None
    if phases is not None:
        trust = SyncTrust(
            videos=[
                VideoTrust(
                    id=v, phase_s=phase, outlier_score=0.0, mirror_margin=0.0,
                    left_out_frames=0.0, left_out_s=0.0, left_out_share=1.0,
                )
                for v, phase in phases.items()
            ],
            triples=[],
        )  # fmt: skip
    count = sum(LENGTHS.values())
    sync = Sync(
        reference="a", ids=list(LENGTHS), lengths=list(LENGTHS.values()),
        maps=[
            SyncMap(id=v, reference_frame=30 * PHASES[v], confidence=np.ones(LENGTHS[v]))
            for v in LENGTHS
        ],
        method="als", centrality=np.ones(2), status="", trust=trust,
        affinity=np.zeros((count, count), dtype=np.float32),
        relaxed=np.zeros((count, count), dtype=np.float32),
    )  # fmt: skip
    return RefineSync(rounds=[], best=0, sync=sync, motion=ba, status="")


@dataclass
class Made:
    """An action's store."""

    store: Store
    out: Path

    def export(self, format: str, up: str | None = None, time: str = "own") -> Exported:
        return export(self.store, "walk", format, self.out, up, time)  # type: ignore[arg-type]

    def publish(self, stage: str, artifact: Artifact) -> None:
        self.store.publish("walk", stage, self.store.put(stage, "k", artifact, {}, {}))


@pytest.fixture
def made(tmp_path: Path) -> Made:
    made = Made(Store(tmp_path / "artifacts"), tmp_path / "out")
    made.publish("keypoints", Keypoints(videos=[keypoints(v) for v in LENGTHS]))
    made.publish("camera_motion", CameraMotion(videos=[turned(v) for v in LENGTHS]))
    made.publish("refine_sync", refined(PHASES))
    return made


def table(file: Path) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The first columns by name, the joints (T, 24, 3)."""
    with file.open(newline="") as stream:
        head, *rows = csv.reader(stream)
    values = np.array([[float(x) if x else np.nan for x in row] for row in rows])
    return dict(zip(head[:4], values[:, :4].T, strict=True)), values[:, 4:].reshape(-1, 24, 3)


@pytest.mark.parametrize("format", sorted(WRITERS))
@pytest.mark.parametrize("time", ["own", "common"])
def test_every_format_writes_its_files_and_says_what_they_are(
    made: Made, format: str, time: str
) -> None:
    done = made.export(format, time=time)
    assert done.said == []
    assert all(f.stat().st_size > 100 for f in done.files)
    names = [f.name for f in done.files]
    assert names[-3:] == ["sync.csv", "cameras.json", f"export_{format}.json"]
    notes = json.loads(done.files[-1].read_text())
    assert {"up_axis", "world", "units", "pivot", "time", "videos", "body_model"} <= set(notes)
    rates = [notes["videos"][v]["frames_per_second"] for v in LENGTHS]
    assert rates == ([30.0, 20.0] if time == "own" else [30.0, 30.0])
    assert notes["up_axis"] == ("-y" if format in ("npz", "csv") else "y")
    frames = [notes["videos"][v]["frames"] for v in LENGTHS]
    assert frames == ([31, 21] if time == "own" else [34, 34])


def test_on_the_common_axis_equal_rows_are_equal_moments(made: Made) -> None:
    made.export("csv", time="common")
    (about, a), (about_b, b) = (table(made.out / f"{v}_joints.csv") for v in LENGTHS)
    np.testing.assert_allclose(about["phase_s"], np.arange(34) / 30, atol=1e-6)
    np.testing.assert_allclose(about_b["phase_s"], about["phase_s"])
    both = (about["inside"] * about_b["inside"]).astype(bool)
    assert both.sum() == 28  # from 0.1 to 1.0 s
    assert np.abs(a - b)[both].max() < 5e-4  # metres: between frames b is interpolated
    np.testing.assert_allclose(b[0], b[3], atol=1e-9)  # not shown yet: its first pose
    assert np.abs(a[0] - a[3]).max() > 0.01
    np.testing.assert_allclose(a[31:], np.broadcast_to(a[30], (3, 24, 3)), atol=1e-9)
    np.testing.assert_allclose(about_b["frame"][3:33], 100 + np.arange(30) * 20 / 30, atol=2e-4)


@pytest.mark.parametrize("time", ["own", "common"])
def test_npz_through_smpl_gives_its_joints(made: Made, time: str) -> None:
    """And under the names of AMASS."""
    made.export("npz", up="z", time=time)
    for video in LENGTHS:
        with np.load(made.out / f"{video}.npz") as data:
            shaped = load_free_body().shape(torch.as_tensor(data["betas"]))
            local = rotations_from_pose(torch.as_tensor(data["poses"]))
            joints = shaped.pose(local, torch.as_tensor(data["trans"])).joints.numpy()
            assert 1000 * np.abs(joints - data["joints"]).max() < 1e-3
            assert str(data["gender"]) == "neutral"
            assert (
                data["mocap_framerate"] == data["fps"] == (30 if time == "common" else FPS[video])
            )
            assert ("phase_s" in data.files) == (time == "common")
            heights = data["joints"][..., 2]
            assert heights[:, SMPL_JOINTS.index("head")].min() > 1.2
            assert abs(heights[:, SMPL_JOINTS.index("left_foot")].min()) < 0.1


def test_a_cameras_turning_goes_with_it(made: Made) -> None:
    result = read_result(made.store, "walk", "y")
    b = result.performances[1]
    camera = camera_of(b)
    point = b.body.joints[20, 0]
    first = b.pose.R @ point + b.pose.t
    in_frame = turned("b").R_first_from_frame[20].T @ first
    ours = camera.R_cam_from_world[20] @ (point - camera.centre)
    np.testing.assert_allclose(ours, in_frame, atol=1e-9)
    assert len(camera_of(result.performances[0]).R_cam_from_world) == 1
    common = camera_of(on_common_time(result).performances[1])
    np.testing.assert_allclose(
        common.R_cam_from_world[9], camera.R_cam_from_world[4], atol=1e-7
    )  # 0.3 s on the axis is its frame 4


def test_who_has_no_place_on_the_axis_is_left_out_and_named(made: Made) -> None:
    nowhere = {"a": PHASES["a"], "b": np.full(21, np.nan)}
    made.publish("refine_sync", refined(nowhere))
    done = made.export("bvh", time="common")
    assert done.said == ["left out, as they have no place on the common axis: b"]
    assert not (made.out / "b.bvh").exists()
    assert json.loads(done.files[-1].read_text())["left_out"] == ["b"]
    assert (made.out / "sync.csv").read_text().count("\nb,") == 21
    assert len(made.export("bvh", time="own").files) == 5


def test_without_an_axis_there_is_no_common_timeline(made: Made) -> None:
    made.publish("refine_sync", refined(None))
    with pytest.raises(WorkFailed, match="walk has no common time axis"):
        made.export("trc", time="common")
    made.export("trc")


def test_wrong_wishes(made: Made) -> None:
    with pytest.raises(WrongUse, match="a GLB file is y up by its specification"):
        made.export("glb", up="z")
    with pytest.raises(WrongUse, match=r"--format: expected one of npz, bvh, glb.*got fbx"):
        made.export("fbx")


def test_a_body_of_another_version_is_said(made: Made) -> None:
    found = refined(PHASES)
    other = found.motion.model_copy(update={"model_digest": "0" * 64})
    made.publish("refine_sync", found.model_copy(update={"motion": other}))
    with pytest.raises(WorkFailed, match=r"made with the body model free_body \(000000000000\)"):
        made.export("bvh")
    made.export("npz")  # which needs no body


def test_a_colour_in_linear_light() -> None:
    assert linear("#ffffff") == (1.0, 1.0, 1.0)
    assert linear("#000000") == (0.0, 0.0, 0.0)
    assert linear("#808080")[0] == pytest.approx(0.2159, abs=1e-4)

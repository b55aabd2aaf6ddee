"""BVH, TRC, tables and calibrations read back by parsers of their own: the joints are ours, the
angles go on smoothly. IMOCAP_GMR: a checkout of the retargeter GMR, whose code then reads one."""

import csv
import importlib
import os
import sys
import tomllib
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.io.writers import text_files
from imocap_core.io.writers.bvh import LAFAN1_JOINTS, as_lafan1, bvh_text, euler_zyx_deg, write_bvh
from imocap_core.io.writers.motion_clip import scaled, upright_rest
from tests.io.made_clips import made_clip

GMR = os.environ.get("IMOCAP_GMR")


@dataclass
class Bone:
    """One block of the hierarchy."""

    name: str
    parent: int
    offset: np.ndarray
    channels: list[str] = field(default_factory=list)


def parse(text: str) -> tuple[list[Bone], float, np.ndarray]:
    """Bones (end sites too), seconds a frame, and the channels (T, C): by tokens, as BVH has it."""
    tokens = iter(text.split())
    bones: list[Bone] = []
    open_: list[int] = []
    for token in tokens:
        if token in ("ROOT", "JOINT", "End"):
            name = next(tokens)
            bones.append(Bone(name, open_[-1] if open_ else -1, np.zeros(3)))
        elif token == "{":
            open_.append(len(bones) - 1)
        elif token == "}":
            open_.pop()
        elif token == "OFFSET":
            bones[-1].offset = np.array([float(next(tokens)) for _ in range(3)])
        elif token == "CHANNELS":
            bones[-1].channels = [next(tokens) for _ in range(int(next(tokens)))]
        elif token == "MOTION":
            break
    assert not open_
    assert [next(tokens) for _ in range(1)] == ["Frames:"]
    frames = int(next(tokens))
    assert [next(tokens) for _ in range(2)] == ["Frame", "Time:"]
    step = float(next(tokens))
    numbers = np.array([float(x) for x in tokens])
    return bones, step, numbers.reshape(frames, -1)


def positions_of(bones: list[Bone], row: np.ndarray) -> dict[str, np.ndarray]:
    """World positions in one frame: every channel applied in its order, from the root down."""
    world: list[tuple[np.ndarray, np.ndarray]] = []
    column = 0
    for bone in bones:
        R, shift = np.eye(3), bone.offset.copy()
        for channel in bone.channels:
            axis = "XYZ".index(channel[0])
            if channel.endswith("position"):
                shift[axis] += row[column]
            else:
                R = R @ Rotation.from_euler(channel[0], row[column], degrees=True).as_matrix()
            column += 1
        R_up, place_up = world[bone.parent] if bone.parent >= 0 else (np.eye(3), np.zeros(3))
        world.append((R_up @ R, place_up + R_up @ shift))
    assert column == len(row)
    return {b.name: w[1] for b, w in zip(bones, world, strict=True) if b.name != "Site"}


@pytest.mark.parametrize("hands", [False, True])
@pytest.mark.parametrize("up", ["y", "z"])
def test_joints_come_back(hands: bool, up: str) -> None:
    clip = made_clip(hands=hands).clip
    bones, step, rows = parse(bvh_text(upright_rest(clip, up)))
    assert step == pytest.approx(1 / clip.fps, abs=1e-9)
    assert len(rows) == len(clip.frames)
    for t, row in enumerate(rows):
        positions = positions_of(bones, row)
        assert set(positions) == set(clip.joint_names)
        theirs = np.array([positions[name] for name in clip.joint_names])
        assert 1000 * np.abs(theirs - clip.joints[t]).max() < 0.02  # millimetres


def test_the_tree_is_smpls_and_ends_in_sites() -> None:
    clip = made_clip().clip
    bones, _, _ = parse(bvh_text(clip))
    named = [b for b in bones if b.name != "Site"]
    assert {b.name: bones[b.parent].name for b in named[1:]} == {
        name: clip.joint_names[parent]
        for name, parent in zip(clip.joint_names[1:], clip.parents[1:], strict=True)
    }
    assert sum(b.name == "Site" for b in bones) == len(clip.tips) == 5
    assert [len(b.channels) for b in named] == [6] + [3] * 23


def test_angles_go_on_without_jumps() -> None:
    """Through the pole of the middle angle and over half a turn."""
    t = np.linspace(0, 1, 200)
    path = Rotation.from_euler("ZYX", np.stack([400 * t, 170 * t, -300 * t], 1), degrees=True)
    angles = euler_zyx_deg(path.as_matrix()[:, None])[:, 0]
    back = Rotation.from_euler("ZYX", angles, degrees=True)
    assert (back.inv() * path).magnitude().max() < 1e-6
    assert np.abs(np.diff(angles, axis=0)).max() < 5.0


def test_the_same_clip_gives_the_same_bytes(tmp_path: Path) -> None:
    clip = made_clip().clip
    write_bvh(tmp_path / "a.bvh", clip)
    write_bvh(tmp_path / "b.bvh", clip)
    assert (tmp_path / "a.bvh").read_bytes() == (tmp_path / "b.bvh").read_bytes()
    assert b"\r" not in (tmp_path / "a.bvh").read_bytes()


def test_lafan1s_reader_finds_its_joints_where_ours_are() -> None:
    """Names, order, channels, unit and rate of its files; FK as its reader does."""
    made = made_clip(frames=9, fps=30.0, hands=True)
    bones, step, rows = parse(bvh_text(scaled(as_lafan1(made.clip), 100.0)))
    joints = [bone for bone in bones if bone.channels]
    assert [bone.name for bone in joints] == list(LAFAN1_JOINTS)
    assert [len(bone.channels) for bone in joints] == [6] + [3] * 21
    assert joints[1].channels == ["Zrotation", "Yrotation", "Xrotation"]
    assert step == pytest.approx(1 / 30)
    for t in (0, 8):
        found = positions_of(bones, rows[t])
        for name, ours in LAFAN1_JOINTS.items():
            place = made.clip.joints[t, made.clip.joint_names.index(ours)]
            np.testing.assert_allclose(found[name], 100 * place, atol=1e-3)


@pytest.mark.filterwarnings("ignore")  # of its regular expressions
@pytest.mark.skipif(GMR is None, reason="IMOCAP_GMR names no checkout of it")
def test_gmr_finds_lafan1s_joints_where_ours_are(tmp_path, monkeypatch):
    package = ModuleType("general_motion_retargeting")  # without its robots and its viewer
    package.__path__ = [f"{GMR}/{package.__name__}"]
    monkeypatch.setitem(sys.modules, package.__name__, package)
    reader = importlib.import_module(f"{package.__name__}.utils.lafan1")
    made = made_clip(frames=9, fps=30.0)
    write_bvh(tmp_path / "a.bvh", scaled(as_lafan1(made.clip), 100.0))
    frames, _ = reader.load_lafan1_file(str(tmp_path / "a.bvh"))
    for t in (0, 8):
        for name, ours in LAFAN1_JOINTS.items():
            x, y, z = made.clip.joints[t, made.clip.joint_names.index(ours)]
            np.testing.assert_allclose(frames[t][name][0], [x, -z, y], atol=1e-4)  # z up, metres


def test_lafan1s_axes_lie_along_the_bones() -> None:
    """Of a body in T pose that looks along +z: what retargeters take from the joints' axes."""
    clip = made_clip().clip
    still = replace(clip, R_local=np.tile(np.eye(3), (*clip.R_local.shape[:2], 1, 1)))
    robot = as_lafan1(still)
    world = np.zeros((22, 3, 3))
    for j, parent in enumerate(robot.parents):
        world[j] = robot.R_local[0, j] if parent < 0 else world[parent] @ robot.R_local[0, j]
    axes = dict(zip(robot.joint_names, np.swapaxes(world, 1, 2), strict=True))  # rows x, y, z
    left, up, ahead = np.eye(3)
    for name, x, z in (
        ("Hips", up, left), ("Spine2", up, left), ("LeftUpLeg", -up, -left),
        ("RightLeg", -up, -left), ("LeftToe", ahead, -left), ("LeftArm", left, up),
        ("RightForeArm", -left, -up),
    ):  # fmt: skip
        assert axes[name][0] @ x > 0.95, name
        assert axes[name][2] @ z > 0.95, name
    offsets = dict(zip(robot.joint_names, robot.offsets, strict=True))
    for name in ("LeftLeg", "RightFoot", "LeftToe", "RightForeArm", "LeftHand"):
        np.testing.assert_allclose(offsets[name][1:], 0, atol=1e-12)
        assert offsets[name][0] > 0


def test_lafan1_is_30_frames_a_second() -> None:
    clip = made_clip(frames=13, fps=60.0).clip
    slow = as_lafan1(clip)
    assert len(slow.R_local) == 7
    np.testing.assert_allclose(slow.pelvis, clip.pelvis[::2], atol=1e-12)
    np.testing.assert_allclose(slow.joints[3, 0], clip.joints[6, 0], atol=1e-9)
    np.testing.assert_allclose(slow.joints[3, -1], clip.joints[6, 21], atol=1e-6)


R = Rotation.from_rotvec([0.3, -1.2, 0.4]).as_matrix()
CAMERA = text_files.CameraCalibration(
    "cam 1", (1080, 1920), np.array([[1700.5, 0, 539.5], [0, 1700.5, 959.5], [0, 0, 1]]), R,
    np.array([0.1, -0.2, 4.0]), (-0.05,),
)  # fmt: skip


def test_calib_toml_is_what_pose2sim_reads(tmp_path: Path) -> None:
    text_files.write_calibration(tmp_path, [CAMERA])
    table = tomllib.loads((tmp_path / "Calib.toml").read_text())
    camera = table["cam 1"]
    assert camera["size"] == [1080.0, 1920.0]
    np.testing.assert_allclose(camera["matrix"], CAMERA.K)
    np.testing.assert_allclose(cv2.Rodrigues(np.array(camera["rotation"]))[0], R)
    np.testing.assert_allclose(camera["translation"], CAMERA.t)
    assert camera["distortions"] == [-0.05, 0.0, 0.0, 0.0]
    assert camera["fisheye"] is False
    assert list(table) == ["cam 1", "metadata"]


def test_yml_is_opencvs_file_storage(tmp_path: Path) -> None:
    camera = text_files.CameraCalibration("cam1", CAMERA.size, CAMERA.K, R, CAMERA.t, (-0.05,))
    files = text_files.write_calibration(tmp_path, [camera])
    intri, extri = (cv2.FileStorage(str(file), cv2.FILE_STORAGE_READ) for file in files[1:])
    np.testing.assert_allclose(intri.getNode("K_cam1").mat(), camera.K)
    np.testing.assert_allclose(intri.getNode("dist_cam1").mat(), [[-0.05, 0, 0, 0, 0]])
    np.testing.assert_allclose(extri.getNode("Rot_cam1").mat(), R)
    np.testing.assert_allclose(cv2.Rodrigues(extri.getNode("R_cam1").mat())[0], R)
    np.testing.assert_allclose(extri.getNode("T_cam1").mat()[:, 0], camera.t)
    assert intri.getNode("names").at(0).string() == "cam1"


def test_a_third_radial_coefficient_is_written_where_there_is_one(tmp_path: Path) -> None:
    coefficients = (-0.2, 0.05, 0.001, -0.002, 0.01)
    camera = text_files.CameraCalibration("cam1", CAMERA.size, CAMERA.K, R, CAMERA.t, coefficients)
    files = text_files.write_calibration(tmp_path, [camera])
    table = tomllib.loads(files[0].read_text())
    assert table["cam1"]["distortions"] == list(coefficients)
    intri = cv2.FileStorage(str(files[1]), cv2.FILE_STORAGE_READ)
    np.testing.assert_allclose(intri.getNode("dist_cam1").mat(), [coefficients])


def test_trc_comes_back(tmp_path: Path) -> None:
    clip = made_clip(fps=29.97).clip
    text_files.write_trc(tmp_path / "v1.trc", clip)
    lines = (tmp_path / "v1.trc").read_text().split("\n")
    assert lines[0] == "PathFileType\t4\t(X/Y/Z)\tv1.trc"
    about = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=True))
    assert about["Units"] == "mm"
    assert about["DataRate"] == about["CameraRate"] == about["OrigDataRate"] == "29.97"
    assert (about["NumFrames"], about["NumMarkers"]) == ("12", "24")
    assert (about["OrigDataStartFrame"], about["OrigNumFrames"]) == ("7", "12")
    names = lines[3].split("\t")
    assert names[:2] == ["Frame#", "Time"]
    assert names[2::3][:24] == list(clip.joint_names)
    assert lines[4].split("\t")[2:8] == ["X1", "Y1", "Z1", "X2", "Y2", "Z2"]
    assert lines[5] == ""
    rows = np.array([[float(x) for x in line.split("\t")] for line in lines[6:-1]])
    np.testing.assert_array_equal(rows[:, 0], np.arange(1, 13))
    np.testing.assert_allclose(rows[:, 1], np.arange(12) / 29.97, atol=1e-6)
    np.testing.assert_allclose(rows[:, 2:].reshape(12, 24, 3), 1000 * clip.joints, atol=6e-4)


def test_trc_names_the_nearest_first_frame(tmp_path: Path) -> None:
    clip = made_clip().clip
    text_files.write_trc(tmp_path / "x.trc", replace(clip, frames=clip.frames + 0.4))
    assert (tmp_path / "x.trc").read_text().split("\n")[2].split("\t")[6] == "7"


def test_csv_comes_back(tmp_path: Path) -> None:
    clip = made_clip(hands=True).clip
    phase = clip.phase_s.copy()
    phase[3] = np.nan
    inside = clip.inside.copy()
    inside[-1] = False
    frames = clip.frames + 0.25
    sd = {"left_wrist": np.where(np.arange(len(phase)) == 2, np.nan, 12.5)}
    written = replace(clip, phase_s=phase, inside=inside, frames=frames)
    text_files.write_joints_csv(tmp_path / "v1.csv", written, sd)
    with (tmp_path / "v1.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["inside"] for row in rows] == ["1"] * 11 + ["0"]
    assert rows[3]["phase_s"] == ""
    assert [row["left_wrist_sd_m"] for row in rows[1:4]] == ["0.012500", "", "0.012500"]
    assert "right_wrist_sd_m" not in rows[0]
    assert rows[0]["frame"] == "7.25"
    for j, name in enumerate(clip.joint_names):
        ours = [[float(row[f"{name}_{axis}_m"]) for axis in "xyz"] for row in rows]
        np.testing.assert_allclose(ours, clip.joints[:, j], atol=6e-7)

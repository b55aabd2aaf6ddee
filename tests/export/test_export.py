"""export --format npz: the files that interfaces.md promises, one body in one world; what is asked
of Blender."""

import csv
import json
import sys
from pathlib import Path

import numpy as np
import pytest

from imocap_core.artifacts.schemas import Hands
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.export.blender import HERE, blender_program, command, run_in_blender
from imocap_core.export.export_options import ExportOptions
from imocap_core.export.formats import check_format
from imocap_core.io.readers.smpl_estimators import read_smpl_npz
from tests.pipeline.made_result import (
    LENGTHS,
    PHASES,
    R_B,
    Made,
    hands,
    made_result,
    motion,
    refined,
)


@pytest.fixture
def made(tmp_path) -> Made:
    return made_result(tmp_path)


def test_what_lies_there(made):
    names = [f.name for f in made.export("npz").files]
    assert names == ["a.npz", "b.npz", "sync.csv", "cameras.json", "export_npz.json"]
    shapes = {
        "poses": (21, 72), "betas": (10,), "trans": (21, 3), "joints": (21, 24, 3),
        "joint_names": (24,), "fps": (), "mocap_framerate": (), "frames": (21,), "K": (3, 3),
        "R": (3, 3), "t": (3,), "model": (), "up_axis": (),
    }  # fmt: skip
    per_frame = {"K_frames": (21, 3, 3), "R_frames": (21, 3, 3), "t_frames": (21, 3)}
    with np.load(made.out / "a.npz") as data:  # its camera stands
        assert set(data.files) == set(shapes)
    with np.load(made.out / "b.npz") as data:
        assert {name: data[name].shape for name in data.files} == shapes | per_frame
        assert str(data["model"]).startswith("free_body ")
        assert str(data["up_axis"]) == "-y"
        assert list(data["joint_names"]) == list(SMPL_JOINTS)
        np.testing.assert_array_equal(data["frames"], 100 + np.arange(21))
        seen = data["joints"] @ data["R"].T + data["t"]  # in the world of a, whose axes are its own
        np.testing.assert_allclose(seen, motion("b").joints, atol=1e-9)
    read = read_smpl_npz(made.out / "b.npz", 100 + np.arange(21))  # our own reader takes it
    assert read.theta.shape == (21, 72)
    np.testing.assert_array_equal(read.R, R_B)


def test_sync_and_cameras_speak_in_source_frames_and_pixels(made):
    found = refined(PHASES)
    at = found.sync.maps[1].reference_frame + 0.5
    at[3] = np.nan
    maps = [found.sync.maps[0], found.sync.maps[1].model_copy(update={"reference_frame": at})]
    sync = found.sync.model_copy(update={"maps": maps})
    made.publish("refine_sync", found.model_copy(update={"sync": sync}))
    made.export("npz")
    with (made.out / "sync.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [row["video"] for row in rows] == ["b"] * 21
    names = ("video", "frame", "reference_frame", "confidence", "phase_s")
    first = dict(zip(names, ("b", "100", "103.500", "1.000", "0.1000"), strict=True))
    assert rows[0] == first
    assert rows[3]["reference_frame"] == ""
    content = json.loads((made.out / "cameras.json").read_text())
    assert content["reference"] == "a"
    assert content["cameras"]["b"]["size"] == [640, 360]
    np.testing.assert_array_equal(content["cameras"]["b"]["R"], R_B)


@pytest.mark.parametrize("up", [None, "y"])
def test_hands_make_it_smplh_and_where_there_are_none_nothing_is_said(made, up):
    status = {"model": "f", "model_digest": "d", "size": 1.0, "status": ""}
    made.publish("hands", Hands(videos=[hands(v) for v in LENGTHS], **status))
    made.export("npz", up)
    with np.load(made.out / "b.npz") as data:
        assert data["joints"].shape == (21, 24, 3)
        assert data["poses_smplh"].shape == (21, 156)
        np.testing.assert_array_equal(data["poses_smplh"][:, :60], data["poses"][:, :60])
        assert (data["poses_smplh"][:, 60:66] == 0.1).all()
        assert (data["poses_smplh"][:, 66:] == 0.3).all()
        wrists = data["joints"][:, 20:22]
        np.testing.assert_allclose(data["hand_points"][:, :, 7], wrists, atol=1e-9)
        assert data["hand_seen"].all()
    made.publish("hands", Hands(videos=[], **status))
    made.export("npz", up)
    with np.load(made.out / "a.npz") as data:
        assert not [name for name in data.files if "hand" in name or "smplh" in name]


def test_a_blender_and_a_python_get_the_same_script() -> None:
    script = Path("convert.py")
    assert command(Path("/opt/blender-4.5/blender"), script, "jobs.json") == [
        "/opt/blender-4.5/blender", "--background", "--factory-startup", "--python-exit-code", "1",
        "--python", "convert.py", "--", "jobs.json",
    ]  # fmt: skip
    assert command(Path("python3"), script, "a") == ["python3", "-P", "convert.py", "--", "a"]


def test_a_python_without_bpy_is_named(tmp_path: Path) -> None:
    (tmp_path / "convert.py").write_text("import no_such_module_as_bpy")
    with pytest.raises(
        WorkFailed, match=r"no_such_module_as_bpy.*IMOCAP_BLENDER must name"
    ) as said:
        run_in_blender(Path(sys.executable), tmp_path / "convert.py", "jobs.json")
    assert "\n" not in str(said.value)
    with pytest.raises(WorkFailed, match="cannot start"):
        run_in_blender(tmp_path / "nothing", tmp_path / "convert.py", "jobs.json")


def test_a_blender_that_is_not_there_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMOCAP_BLENDER", "/no/such/blender")
    with pytest.raises(WorkFailed, match="IMOCAP_BLENDER: the program /no/such/blender does not"):
        blender_program(lambda step: None)


def test_blender_is_pinned_with_hashes() -> None:
    blocks = (HERE / "bpy.txt").read_text().split("\n", 1)[1].split("\n\n")[0]
    assert [line.split("==")[0] for line in blocks.splitlines() if "==" in line] == ["bpy", "numpy"]
    assert blocks.count("--hash=sha256:") > 4


def test_fbx_has_its_own_axes_and_unit() -> None:
    with pytest.raises(WrongUse, match="an FBX file is y up"):
        check_format("fbx", "z")
    check_format("usd", "z")
    ExportOptions(names="ue5", root_bone=True).check("usd")

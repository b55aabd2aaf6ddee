"""imocap export and imocap compare as one types them: what is message, and how they end."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from imocap_core.artifacts.schemas import CameraMotion, Keypoints, RefineSync
from imocap_core.cli import main
from imocap_core.params import RefineParams
from tests.pipeline.made_result import FPS, LENGTHS, Made, made_result
from tests.pipeline.stored import publish

Capture = pytest.CaptureFixture[str]
Said = tuple[int, str, str]
KINDS = {"keypoints": Keypoints, "camera_motion": CameraMotion, "refine_sync": RefineSync}


@pytest.fixture
def made(tmp_path: Path) -> Made:
    action = tmp_path / "actions" / "walk"
    action.mkdir(parents=True)
    videos = [{"id": v, "keypoints": v, "fps": FPS[v], "size": [640, 360]} for v in LENGTHS]
    (action / "action.yaml").write_text(yaml.safe_dump({"name": "walk", "videos": videos}))
    for v in LENGTHS:
        (action / v).write_text("keypoints")
    made = made_result(tmp_path)
    for stage in ("keypoints", "camera_motion", "refine_sync"):  # now as a run makes them
        stored = made.store.load("walk", stage)
        publish(tmp_path, "walk", stage, stored.decode(KINDS[stage]))
    return made


@pytest.fixture
def imocap(tmp_path, made, capsys):
    def run(*words: str) -> Said:
        code = main(["--root", str(tmp_path), *words])
        message = capsys.readouterr()
        return code, message.out, message.err

    return run


def test_export_names_its_files(imocap: Callable[..., Said], tmp_path: Path) -> None:
    out = tmp_path / "there"
    code, message, _ = imocap("export", "walk", "--format", "bvh", "--up", "z", "--out", str(out))
    assert code == 0
    names = ["a.bvh", "b.bvh", "sync.csv", "cameras.json", "export_bvh.json"]
    assert message.splitlines() == [str(out / name) for name in names]


def test_an_export_names_the_run_that_it_is_of(imocap, made, tmp_path):
    assert imocap("export", "walk", "--out", str(tmp_path / "there"))[0] == 0
    run = json.loads((tmp_path / "there" / "export_npz.json").read_text())["run"]
    motion = made.store.load("walk", "refine_sync")
    assert run["stages"]["refine_sync"] == {"key": motion.key, "digest": motion.digest}
    assert list(run["stages"]) == ["keypoints", "camera_motion", "refine_sync"]
    assert run["seed"] == 7
    assert run["params"]["refine"]["max_rounds"] == RefineParams().max_rounds


def test_an_export_of_edited_keypoints_is_refused(imocap, tmp_path):
    (tmp_path / "actions" / "walk" / "a").write_text("edited")
    code, _, message = imocap("export", "walk", "--out", str(tmp_path / "there"))
    assert (code, message.count("\n")) == (1, 1)
    assert "(keypoints: read: detections a has changed)" in message
    assert message.endswith("Bring them up to date: imocap run walk\n")
    assert not (tmp_path / "there").exists()


def test_an_export_replaces_nothing_but_an_older_one_of_its_kind(imocap, tmp_path):
    inputs = tmp_path / "actions" / "walk"
    np.savez(inputs / "a.npz", keypoints=np.zeros(3))
    before = {p.name: p.read_bytes() for p in inputs.iterdir()}
    for words in (("export",), ("compare",), ("export", "--format", "bvh")):
        for place in (inputs, inputs / "videos"):
            code, _, message = imocap(words[0], "walk", *words[1:], "--out", str(place))
            assert (code, message.count("\n")) == (2, 1)
            assert "walk is an action, whose files might be replaced" in message
    assert {p.name: p.read_bytes() for p in inputs.iterdir()} == before

    out = tmp_path / "there"
    out.mkdir()
    (out / "a.npz").write_bytes(b"mine")
    code, _, message = imocap("export", "walk", "--out", str(out))
    assert (code, message.count("\n")) == (1, 1)
    assert "a.npz exists, and was not written by an export" in message
    assert [p.name for p in out.iterdir()] == ["a.npz"]
    (out / "a.npz").unlink()
    assert imocap("export", "walk", "--out", str(out))[0] == 0
    cameras = (out / "cameras.json").read_bytes()
    code, _, message = imocap("export", "walk", "--format", "bvh", "--out", str(out))  # y is up
    assert code == 1
    assert "cameras.json belongs to export_npz.json, an export of other axes" in message
    assert (out / "cameras.json").read_bytes() == cameras
    assert sorted(p.suffix for p in out.iterdir() if p.suffix == ".bvh") == []
    assert imocap("export", "walk", "--up", "y", "--out", str(out))[0] == 0  # its own, again
    assert (out / "cameras.json").read_bytes() != cameras
    assert imocap("export", "walk", "--format", "bvh", "--out", str(out))[0] == 0
    (out / "a.npz").write_bytes(b"edited")
    assert imocap("export", "walk", "--up", "y", "--out", str(out))[0] == 1
    assert (out / "a.npz").read_bytes() == b"edited"
    assert not [p for p in out.iterdir() if p.name.startswith(".")]


def test_export_says_what_can_not_be(imocap: Callable[..., Said], tmp_path: Path) -> None:
    out = str(tmp_path / "there")
    code, _, message = imocap("export", "walk", "--format", "glb", "--up", "z", "--out", out)
    assert code == 2
    assert message.startswith("imocap: --up z: a GLB file is y up")
    assert imocap("export", "walk", "--format", "dae", "--out", out)[0] == 2
    (tmp_path / "file").write_text("")
    code, _, message = imocap("export", "walk", "--out", str(tmp_path / "file"))
    assert (code, message.count("\n")) == (1, 1)
    assert "cannot write to" in message


def test_an_artifact_of_another_version_is_one_sentence(imocap, made, tmp_path):
    publish(tmp_path, "walk", "hands", CameraMotion(videos=[]))  # not what its name says
    code, _, message = imocap("export", "walk", "--out", str(tmp_path / "there"))
    assert (code, message.count("\n")) == (1, 1)
    assert "hands of walk: expected a Hands, got a CameraMotion" in message
    assert message.endswith("run it with: imocap run walk\n")


def test_compare(imocap: Callable[..., Said], tmp_path: Path) -> None:
    code, message, _ = imocap("compare", "walk")
    assert code == 0
    first, report, beside = message.splitlines()
    assert first.startswith("walk: consistency 1.000")
    assert Path(report) == tmp_path / "artifacts" / "walk" / "report" / "compare" / "report.html"
    assert Path(report).is_file()
    assert beside.startswith("Beside it: joints.csv, performances.csv")
    code, _, message = imocap("compare", "walk", "walk")
    assert (code, message) == (2, "imocap: walk and walk are one action; leave the second out\n")
    assert imocap("compare", "walk", "nobody")[0] == 2

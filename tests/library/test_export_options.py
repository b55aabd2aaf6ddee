"""Export options on a run: which videos, whose mean, from where, as what character."""

import json
from pathlib import Path

import numpy as np
import pytest

import imocap
from imocap_core.cli import main
from imocap_core.export.export_options import ExportOptions
from imocap_core.result.derived import fade, from_start, mean_performance
from tests.library.conftest import SmallRun


@pytest.mark.parametrize("up", ["y", "z"])
def test_a_motion_starts_at_the_origin_facing_forward(small_run: SmallRun, up: str) -> None:
    level = small_run.result.levelled(up)
    begun = from_start(level, level.videos[0])
    first = begun.videos[0]
    flat = [0, 2] if up == "y" else [0, 1]
    np.testing.assert_allclose(first.body_joints[0, 0, flat], 0, atol=1e-9)
    ahead = first.rotations[0, 0] @ [0, 0, 1]
    forward = np.array([0, 0, 1.0]) if up == "y" else np.array([0, -1.0, 0])
    assert ahead @ forward > 0.9 * np.linalg.norm(ahead[flat])
    for before, after in zip(level, begun, strict=True):
        gaps = [np.linalg.norm(v.body_joints[0] - v.camera.centre, axis=1) for v in (before, after)]
        np.testing.assert_allclose(*gaps, atol=1e-9)
        height = "xyz".index(up)
        np.testing.assert_allclose(
            before.body_joints[..., height], after.body_joints[..., height], atol=1e-9
        )


def test_the_mean_of_equal_performances_is_each_of_them(small_run: SmallRun) -> None:
    common = small_run.result.levelled("y").on_common_time()
    one = common.only(["v1"])
    again = mean_performance(one)
    np.testing.assert_allclose(again["mean"].body_joints, one["v1"].body_joints, atol=1e-6)
    both = mean_performance(common)["mean"]
    low = np.minimum(common["v1"].trans, common["v2"].trans) - 1e-9
    high = np.maximum(common["v1"].trans, common["v2"].trans) + 1e-9
    assert ((low <= both.trans) & (both.trans <= high)).all()
    assert both.inside.all()


def test_weights_fade_where_a_performance_begins_and_ends() -> None:
    inside = np.array([False] * 5 + [True] * 40 + [False] * 3)
    weights = fade(inside, fps=20)
    assert (weights[~inside] == 0).all()
    assert (weights[inside] > 0).all()
    assert np.abs(np.diff(weights)).max() < 0.2
    assert weights.max() == 1


def test_a_character_of_one_video(small_run: SmallRun, tmp_path: Path) -> None:
    options = ExportOptions(("v2",), origin="start", names="ue5", root_bone=True)
    files = small_run.result.export("bvh", tmp_path, options=options)
    assert [f.name for f in files if f.suffix == ".bvh"] == ["v2.bvh"]
    text = (tmp_path / "v2.bvh").read_text()
    assert "ROOT root" in text
    assert "JOINT upperarm_l" in text
    notes = json.loads((tmp_path / "export_bvh.json").read_text())
    assert notes["options"]["names"] == "ue5"
    assert list(notes["videos"]) == ["v2"]


def test_the_mean_as_a_skinned_mesh(small_run: SmallRun, tmp_path: Path) -> None:
    options = imocap.ExportOptions(mean=True, names="mixamo", root_bone=True)
    files = small_run.result.export("glb", tmp_path, options=options)
    data = files[0].read_bytes()
    assert data[:4] == b"glTF"
    assert b"mixamorig:Hips" in data
    assert b'"mean_body"' in data


@pytest.mark.parametrize("up", ["y", "z"])
def test_feet_that_are_locked_do_not_slide(small_run, tmp_path, up):
    options = imocap.ExportOptions(mean=True, lock_feet=True)
    small_run.result.export("npz", tmp_path, up=up, options=options)
    notes = json.loads((tmp_path / "export_npz.json").read_text())
    lock = notes["foot_lock"]["mean"]
    assert lock["slides_mm"] <= min(1e-3, lock["slid_mm"]) or lock["short"] > 0
    assert len(np.load(tmp_path / "mean.npz")["poses"]) == notes["videos"]["mean"]["frames"]


def test_locked_feet_are_said(small_run, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["imocap"])
    words = ["--out", str(tmp_path), "--root", str(small_run.root), "--video", "v1", "--lock-feet"]
    assert main(["export", "serve", "--format", "npz", *words]) == 0
    message = capsys.readouterr().out.replace("\n", " ")
    assert "v1: feet in contact (" in message or "v1: no foot stands" in message


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--format", "csv", "--names", "mixamo"], "csv has none"),
        (["--mean", "--video", "v1"], "leave --video out"),
        (["--video", "v9"], "has no video 'v9'; there are: v1, v2"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    small_run, tmp_path, monkeypatch, capsys, words, sentence
):
    monkeypatch.setattr("sys.argv", ["imocap"])
    out = ["--out", str(tmp_path), "--root", str(small_run.root)]
    assert main(["export", "serve", *out, *words]) == 2
    assert sentence in capsys.readouterr().err
    assert not list(tmp_path.iterdir())

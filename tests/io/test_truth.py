"""A calibrated rig's files as truth."""

import ast
from pathlib import Path

import numpy as np
import pytest
import yaml

from imocap_core.io.pose2sim_files import has_pose2sim_truth
from imocap_core.io.truth import project_name, read_pose2sim_truth
from imocap_core.pipeline.action import Action
from imocap_core.pipeline.source import PROJECT, closure


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    xyz = np.arange(5 * 2 * 3, dtype=np.float32).reshape(5, 2, 3)
    np.savez(tmp_path / "trc_reference.npz", xyz_zup_m=xyz, names=np.array(["RHip", "Head"]))
    eye = np.tile(np.eye(3), (2, 1, 1))
    eye[1] *= -1
    np.savez(
        tmp_path / "calibration.npz", K=eye, R=eye, t=np.ones((2, 3)), cams=np.array(["b", "a"])
    )
    return tmp_path


def test_rows_are_source_frame_numbers_and_phases(folder: Path) -> None:
    truth = read_pose2sim_truth(folder, {"a": np.array([1, 2]), "b": np.array([3, 4, 5])})
    a, b = truth.videos["a"], truth.videos["b"]
    np.testing.assert_array_equal(a.joints[:, 0, 0], [6, 12])
    np.testing.assert_array_equal(a.phase, [1, 2])
    np.testing.assert_array_equal(np.isnan(b.joints[:, 0, 0]), [False, False, True])
    assert truth.phase_end == 4
    assert a.joint_names == ("right_hip", "head_top")


def test_cameras_follow_their_ids_not_their_order(folder: Path) -> None:
    truth = read_pose2sim_truth(folder, {"a": np.array([1]), "c": np.array([1])})
    np.testing.assert_array_equal(truth.videos["a"].R, -np.eye(3))
    assert truth.videos["c"].R is None


def test_marker_names() -> None:
    assert project_name("RBigToe") == "right_big_toe"
    assert project_name("LWrist") == "left_wrist"
    assert project_name("Nose") == "nose"
    assert project_name("Neck") == "upper_neck"


def test_recognised_only_as_a_pair(folder: Path) -> None:
    assert has_pose2sim_truth(folder)
    (folder / "calibration.npz").unlink()
    assert not has_pose2sim_truth(folder)


def test_a_wrong_field_is_named(folder: Path) -> None:
    np.savez(folder / "trc_reference.npz", names=np.array(["RHip"]))
    with pytest.raises(ValueError, match=r"trc_reference.*xyz_zup_m"):
        read_pose2sim_truth(folder, {"a": np.array([1])})


def test_a_stage_that_scores_depends_on_both_files(folder: Path) -> None:
    action = Action(folder, "rig", ())
    assert action.truth_files == ("calibration.npz", "trc_reference.npz")
    assert Action(folder, "rig", (), truth="mine.npz").truth_files == ("mine.npz",)
    (folder / "trc_reference.npz").unlink()
    assert not action.truth_files


READERS = {"imocap_core.io.truth"}
GRAPH = yaml.safe_load((PROJECT / "pipeline.yaml").read_text())["stages"]
BEFORE = [PROJECT / spec["script"] for name, spec in GRAPH.items() if name != "evaluate"]


def test_the_graph_gives_it_to_evaluate_alone() -> None:
    assert [name for name, spec in GRAPH.items() if "truth" in spec["reads"]] == ["evaluate"]


@pytest.mark.parametrize("script", BEFORE, ids=lambda script: script.stem)
def test_no_earlier_stage_reaches_a_reader_of_it(script: Path) -> None:
    assert READERS.isdisjoint(closure(script))


@pytest.mark.parametrize("script", BEFORE, ids=lambda script: script.stem)
def test_no_earlier_stage_names_it(script: Path) -> None:
    named = {
        node.attr if isinstance(node, ast.Attribute) else node.value
        for node in ast.walk(ast.parse(script.read_text()))
        if isinstance(node, ast.Attribute)
        or (isinstance(node, ast.Constant) and node.value in ("truth", "truth.npz"))
    }
    assert named.isdisjoint({"truth", "truth.npz"})


def test_evaluate_does() -> None:
    found = closure(PROJECT / GRAPH["evaluate"]["script"])
    assert not READERS.isdisjoint(found)

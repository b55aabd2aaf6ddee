"""The benchmark from pixels: its folders, its tables, and that a second run does nothing again."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.actions.captured_videos import CapturedVideo
from benchmarks.detection_errors import DetectedClip
from benchmarks.rendered import measure, proposal
from benchmarks.rendered_action import RenderedChoice, _with_body_joints, key_of, true_pose
from benchmarks.synthetic.films import FilmedMotion
from benchmarks.synthetic.retargeting import RetargetedMotion
from imocap_core.body import load_free_body
from imocap_core.errors import WrongUse
from imocap_core.rotations import exp
from imocap_core.workspace import Workspace
from tests.benchmarks.test_detector import NAMES, SPREAD, film


def films() -> list[DetectedClip]:
    rng = np.random.default_rng(0)
    return [replace(film(rng, 600), side=side) for side in ("front", "front", "back")]


def test_the_proposal_gives_back_what_simulated_detections_were_made_with() -> None:
    from benchmarks.detection_errors import point_errors

    given = films()
    table = proposal(given, point_errors(given, NAMES), NAMES)
    rows = dict(line.strip("| ").split(" | ") for line in table.splitlines()[2:] if "|" in line)
    assert float(rows["noise"]) == pytest.approx(SPREAD, rel=0.1)
    assert float(rows["persistence_s"]) == pytest.approx(0.3, abs=0.15)
    assert float(rows["swap_rate"]) == 0
    assert float(rows["miss_rate"]) == 0


def test_the_truth_speaks_of_the_common_world_whatever_the_floor() -> None:
    """A joint of the film, in the common world, is where the captured one was."""
    rng = np.random.default_rng(1)
    captured = rng.normal(size=(5, 24, 3))
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    shift = np.array([1.0, 2.0, 0.3])
    shot = CapturedVideo(captured[:, :14], np.arange(5.0), np.arange(5), 30.0, turn, shift)
    floor = 0.12
    filmed = FilmedMotion(
        RetargetedMotion(np.zeros((5, 24, 3, 3)), np.zeros((5, 3))), captured - [0, 0, floor],
        np.eye(3), np.eye(3), np.array([0.0, 0.0, 4.0]), (64, 48), 0.0, floor,
    )  # fmt: skip
    truth = _with_body_joints(shot, filmed).truth("v1", filmed.K, filmed.R, filmed.t)
    assert np.allclose(truth["v1/joints"], captured @ turn.T + shift)
    in_camera = truth["v1/joints"] @ truth["v1/R"].T + truth["v1/t"]
    assert np.allclose(in_camera, filmed.joints + filmed.t)


def test_the_true_pose_puts_the_body_at_its_true_joints() -> None:
    shaped = load_free_body().shape(0.5 * torch.ones(10, dtype=torch.float64))
    theta = 0.3 * torch.randn(4, 24, 3, generator=torch.Generator().manual_seed(1)).double()
    motion = RetargetedMotion(exp(theta).numpy(), np.linspace(0, 1, 12).reshape(4, 3))
    joints = shaped.pose(*map(torch.as_tensor, (motion.R_local, motion.transl))).joints.numpy()
    turn = exp(torch.tensor([0.1, 0.7, -0.4], dtype=torch.float64)).numpy()
    shift = np.array([0.2, -1.0, 3.0])
    shot = CapturedVideo(joints[:, :14], np.arange(4.0), np.arange(4), 30.0, turn, shift)
    pose = true_pose("v1", motion, shot, shaped, np.full(10, 0.5))
    R_local = exp(torch.as_tensor(pose["v1/theta"]).reshape(4, 24, 3))
    posed = shaped.pose(R_local, torch.as_tensor(pose["v1/trans"])).joints.numpy()
    np.testing.assert_allclose(posed, joints @ turn.T + shift, atol=1e-9)


def test_names_and_numbers_are_checked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(WrongUse, match="--videos: expected 1 to 4, got 5"):
        RenderedChoice(videos=5)
    folder = tmp_path / "trials"
    folder.mkdir()
    (folder / "one.npz").write_bytes(b"x")
    monkeypatch.setenv("IMOCAP_DATA", str(tmp_path))
    with pytest.raises(WrongUse, match="--only two: expected one of one"):
        measure(Workspace(tmp_path), RenderedChoice(only=("two",)), None)  # type: ignore[arg-type]


def test_an_action_is_named_by_what_it_is_made_of(tmp_path: Path) -> None:
    file = tmp_path / "one.npz"
    file.write_bytes(b"x")
    keys = {key_of("one", file, videos, small) for videos in (3, 4) for small in (True, False)}
    file.write_bytes(b"y")
    keys.add(key_of("one", file, 4, False))
    assert len(keys) == 5

"""Behind `imocap benchmark protocol` and `trials`: inputs as files, scores kept, tables."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from imocap_core.artifacts.schemas import SyncMap
from imocap_core.artifacts.schemas.sync import SyncSummary
from imocap_core.formats.joints_npz import read_joints_npz
from imocap_core.formats.openpose import read_openpose
from imocap_core.formats.truth import Truth, VideoTruth
from imocap_core.motion.consensus import Cameras
from stages.benchmarks import inputs, score, tables
from stages.benchmarks.motion import Choice
from stages.benchmarks.oracle import fit_with_cameras, true_cameras, true_sync
from stages.benchmarks.score import ActionScore
from stages.cli import main
from stages.harness.action import read_action
from stages.harness.errors import WorkFailed, WrongUse
from tests.motion.made import mpjpe_mm
from tests.motion.test_joint import OPTIONS, in_own_axes, made, whole  # noqa: F401
from tests.synthetic.test_captured import figure


def shots() -> list[inputs.Shot]:
    joints, phase = figure(40), np.arange(40.0)
    kept = [np.arange(40), np.arange(0, 40, 2)]
    return [inputs.Shot(joints, phase, k, 30.0) for k in kept]


def test_an_action_is_made_of_files_that_the_stages_read(tmp_path: Path) -> None:
    folder = tmp_path / "sway"
    inputs.make_action(folder, "sway", shots(), "fine_tuned", {"sync": {"max_rate": 30.0}})
    action = read_action(folder)
    assert [(v.id, v.fps) for v in action.videos] == [("v1", 30.0), ("v2", 15.0)]
    found = read_openpose(folder / "keypoints" / "v2", "coco18")
    assert [p.shape for p in found.people] == [(1, 18, 3)] * 20
    estimate = read_joints_npz(folder / "initial" / "v2.npz", np.arange(20))
    assert estimate.joints.shape == (20, 14, 3)
    with np.load(folder / "truth.npz") as truth:
        assert truth["v2/phase"].tolist() == list(range(0, 40, 2))
        assert truth["phase_end"] == 39


def test_the_truth_of_a_moved_world_is_the_same_before_the_camera() -> None:
    shot, K, R, t = shots()[0], np.eye(3), SWING, np.array([0.0, 1.0, 4.0])
    moved = replace(shot, R_common_from_stage=SWING.T, t_common=np.array([1.0, 2.0, 3.0]))
    seen = []
    for one in (shot, moved):
        parts = one.truth("v1", K, R, t)
        seen.append(parts["v1/joints"] @ parts["v1/R"].T + parts["v1/t"])
    assert seen[1] == pytest.approx(seen[0])


def test_an_action_is_made_once_and_again_when_its_inputs_change(tmp_path: Path) -> None:
    folder = tmp_path / "sway"
    inputs.make_action(folder, "sway", shots(), "fine_tuned", {})
    before = (folder / "action.yaml").stat().st_mtime_ns
    inputs.make_action(folder, "sway", shots(), "fine_tuned", {})
    assert (folder / "action.yaml").stat().st_mtime_ns == before
    inputs.make_action(folder, "sway", shots(), "generic", {})
    assert (folder / "action.yaml").stat().st_mtime_ns != before


def test_two_makings_are_the_same(tmp_path: Path) -> None:
    found = []
    for name in ("a", "b"):
        inputs.make_action(tmp_path / name, "sway", shots(), "generic", {})
        files = sorted(p for p in (tmp_path / name).rglob("*.json") if p.name != inputs.MADE)
        found.append([p.read_text() for p in files])
    assert found[0] == found[1]


def test_absent_data_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(inputs.DATA_VARIABLE, str(tmp_path))
    with pytest.raises(WorkFailed, match=r"holds no \.npz file; put the data there or set IMOCAP_"):
        inputs.data_folder(tmp_path, "trials")


@pytest.mark.parametrize(
    ("choice", "said"),
    [
        ({"name": "dance"}, "expected one of protocol, trials, yoga"),
        ({"name": "trials", "detector": "x"}, "--detector: expected one of fine_tuned"),
        ({"name": "trials", "videos": 5}, "--videos: expected 1 to 4, got 5"),
    ],
)
def test_a_wrong_choice_is_refused(choice: dict, said: str) -> None:
    with pytest.raises(WrongUse, match=said):
        Choice(**choice)


def test_the_command_names_the_whole_choice() -> None:
    choice = Choice("protocol", "generic", "paper", 3, ("cmu_01_08",))
    assert choice.command == (
        "imocap benchmark protocol --detector generic --videos 3 --sampling paper --only cmu_01_08"
    )
    assert choice.label == "protocol-paper-generic-3v"


# --- the oracle


def summary(reference: str = "b") -> SyncSummary:
    maps = [SyncMap(id=i, reference_frame=np.zeros(n), confidence=np.ones(n)) for i, n in LENGTHS]
    return SyncSummary(
        reference=reference,
        ids=[i for i, _ in LENGTHS],
        lengths=[n for _, n in LENGTHS],
        maps=maps,
        method="softmap",
        centrality=np.ones(2),
        status="",
    )


LENGTHS = [("a", 4), ("b", 3)]
SWING = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])


def known_truth() -> Truth:
    def video(phase: list[float], R: np.ndarray, t: list[float]) -> VideoTruth:
        return VideoTruth(None, (), np.eye(3), R, np.array(t), np.array(phase))

    a = video([0.0, 1.0, 2.0, 9.0], SWING, [0.0, 0.0, 4.0])
    return Truth({"a": a, "b": video([0.0, 2.0, 4.0], np.eye(3), [1.0, 0.0, 3.0])}, 4.0)


def test_the_oracle_s_frames_are_where_phases_are_equal() -> None:
    found = true_sync(summary(), known_truth())
    assert found.maps[0].reference_frame[:3].tolist() == [0.0, 0.5, 1.0]
    assert np.isnan(found.maps[0].reference_frame[3])
    assert found.maps[0].confidence.tolist() == [1, 1, 1, 0]
    assert found.maps[1].reference_frame.tolist() == [0, 1, 2]


def test_the_oracle_s_cameras_see_a_world_point_where_the_true_ones_do() -> None:
    truth = known_truth()
    cameras = true_cameras(true_sync(summary(), truth), truth)
    point = np.array([0.3, -0.2, 0.5])
    in_reference = point + [1.0, 0.0, 3.0]
    assert torch.equal(cameras.R[1], torch.eye(3, dtype=torch.float64))
    seen = cameras.R[0].numpy() @ in_reference + cameras.t[0].numpy()
    assert seen == pytest.approx(SWING @ point + [0.0, 0.0, 4.0])


def test_the_oracle_s_fit_leaves_the_cameras_alone(made) -> None:  # noqa: F811
    scene, true = whole(made), in_own_axes(made)
    cameras = Cameras(torch.as_tensor(made.R), torch.as_tensor(made.t))
    start = replace(true, trans=true.trans + 0.05)
    found = fit_with_cameras(scene, start, cameras, replace(OPTIONS, max_steps=3))
    assert found.cameras is cameras
    assert mpjpe_mm(made.body, found.state, true) < 10


def test_the_oracle_of_one_video_is_its_monocular_fit(made) -> None:  # noqa: F811
    true = in_own_axes(made)
    alone = replace(whole(made), observations=made.observations[:1])
    cameras = Cameras(torch.as_tensor(made.R[:1]), torch.as_tensor(made.t[:1]))
    start = true.rows(torch.tensor([0]))
    assert fit_with_cameras(alone, start, cameras, OPTIONS).state is start


# --- tables


def made_score(action: str, loop: float) -> ActionScore:
    numbers = {
        name: {"mpjpe_scaled_mm": value, "pa_mpjpe_mm": value / 2, "sync_error_pct": 0.5}
        for name, value in zip(score.RESULTS, (110.0, 70.0, 50.0, loop, 30.0), strict=True)
    }
    return ActionScore(action, 4, 300, numbers, 60.0, 1.0, "key")


def test_the_share_of_the_gap() -> None:
    assert tables.gap_closed(70, 50, 30) == 50
    assert tables.gap_closed(70, 70, 30) == 0
    assert tables.gap_closed(70, 80, 30) == -25
    assert np.isnan(tables.gap_closed(30, 30, 30))
    assert np.isnan(tables.gap_closed(None, 30, 20))


def test_mean_and_standard_error() -> None:
    assert tables.mean_and_error([1.0, 2.0, 3.0]) == pytest.approx((2.0, 1 / np.sqrt(3)))
    assert np.isnan(tables.mean_and_error([1.0])[1])


def test_the_tables_hold_every_action_its_means_and_the_paper() -> None:
    scores = [made_score("jump", 50.0), made_score("walk", 40.0)]
    benchmark = tables.Benchmark("Title", "imocap benchmark x", "data", "fine_tuned", scores)
    text = tables.markdown(benchmark)
    assert "| jump | 110.0 | 70.0 | 50.0 | 50.0 | 30.0 | 50 |" in text
    assert "| 4 videos | after loop | 66.53 | 45.0 ± 5.0 | 50.33 | 22.5 ± 2.5 |" in text
    assert "`imocap benchmark x`" in text
    assert "jump,after loop,mpjpe_scaled_mm,50.0" in tables.csv_text(benchmark)
    kept = json.loads(tables.json_text(benchmark))
    assert kept["means"]["after loop"]["mpjpe_scaled_mm"]["mean"] == 45.0


def test_generic_detections_stand_beside_the_paper_s_generic_row() -> None:
    benchmark = tables.Benchmark("T", "c", "d", "generic", [made_score("jump", 50.0)])
    assert "| 4 videos, generic 2D | after loop | 76.48 | 50.0 |" in tables.markdown(benchmark)


def test_fewer_videos_stand_beside_the_paper_s_row_of_as_many() -> None:
    scores = [replace(made_score("jump", 50.0), videos=2)]
    benchmark = tables.Benchmark("T", "c", "d", "fine_tuned", scores)
    assert "| 2 videos | after loop | 78.45 | 50.0 |" in tables.markdown(benchmark)


# --- kept scores, exit codes


@dataclass(frozen=True)
class Kept:
    """Stands for a stored artifact of one video."""

    digest: str

    def decode(self, kind: type) -> SimpleNamespace:
        return SimpleNamespace(videos=[SimpleNamespace(frames=range(5))])


def test_a_finished_action_is_not_scored_again_until_an_artifact_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    digest, scored = ["one"], []

    def run(job: object, display: object, stages: object) -> list[SimpleNamespace]:
        return [SimpleNamespace(stage="keypoints", stored=Kept(digest[0]), seconds=2.0)]

    def numbers(*_: object) -> dict:
        scored.append(digest[0])
        return {"oracle": {"pa_mpjpe_mm": 1.0}}

    monkeypatch.setattr(score.runner, "run", run)
    monkeypatch.setattr(score, "_numbers", numbers)
    job = SimpleNamespace(
        action=SimpleNamespace(name="jump", truth=None, folder=tmp_path),
        settings=SimpleNamespace(seed=7),
        pipeline=SimpleNamespace(upstream=lambda stage: ["keypoints"]),
    )
    first = score.score_action(job, None, tmp_path / "jump.json")
    assert score.score_action(job, None, tmp_path / "jump.json") == first
    assert scored == ["one"]
    digest[0] = "two"
    score.score_action(job, None, tmp_path / "jump.json")
    (tmp_path / "jump.json").write_text("{ half a file")
    assert score.score_action(job, None, tmp_path / "jump.json").of("oracle", "pa_mpjpe_mm") == 1.0
    assert scored == ["one", "two", "two"]


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["benchmark", "dance"], 2, "'dance' is not one of"),
        (["benchmark", "trials", "--videos", "9"], 2, "--videos: expected 1 to 4, got 9"),
        (["benchmark", "trials"], 1, "the benchmark trials needs captured motion"),
        (["benchmark", "bones"], 1, "needs captured motion"),
    ],
)
def test_exit_codes(
    words: list[str],
    code: int,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv(inputs.DATA_VARIABLE, str(tmp_path))
    monkeypatch.setattr("sys.argv", ["imocap"])
    assert main(["--root", str(tmp_path), *words]) == code
    assert said in capsys.readouterr().err

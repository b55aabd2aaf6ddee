"""Behind `imocap benchmark protocol` and `trials`: inputs as files, stored scores, tables."""

from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from benchmarks import motion, scoring
from benchmarks.actions import captured_videos as inputs
from benchmarks.actions.action_folder import MADE, action_key, is_made, make_action
from benchmarks.scoring import ActionScore, fit_with_cameras, true_cameras, true_sync
from imocap_core.artifacts.schemas import SyncMap
from imocap_core.artifacts.schemas.sync_schemas import SyncSummary
from imocap_core.cli import main
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.io.readers.estimates import read_joints_npz
from imocap_core.io.readers.json_people import read_openpose
from imocap_core.io.truth import Truth, VideoTruth
from imocap_core.pipeline.action import read_action
from imocap_core.workspace import Workspace
from tests.benchmarks.test_synthetic import figure
from tests.motion.made import FRAMES, TURNS_DEG, Made, mpjpe_mm, scene
from tests.motion.test_smpl_ba import OPTIONS, in_own_axes, whole

SWING = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])


def shots() -> list[inputs.CapturedVideo]:
    joints, phase = figure(40), np.arange(40.0)
    frames = [np.arange(40), np.arange(0, 40, 2)]
    return [inputs.CapturedVideo(joints, phase, f, 30.0) for f in frames]


def test_an_action_is_made_of_files_that_the_stages_read(tmp_path: Path) -> None:
    folder = tmp_path / "sway"
    make_action(folder, "sway", shots, "fine_tuned", {"sync": {"max_rate": 30.0}}, "key")
    action = read_action(folder)
    assert [(v.id, v.fps) for v in action.videos] == [("v1", 30.0), ("v2", 15.0)]
    detections = read_openpose(folder / "keypoints" / "v2", "coco18")
    assert [p.shape for p in detections.people] == [(1, 18, 3)] * 20
    estimate = read_joints_npz(folder / "initial" / "v2.npz", np.arange(20))
    assert estimate.joints.shape == (20, 14, 3)
    with np.load(folder / "truth.npz") as truth:
        assert truth["v2/phase"].tolist() == list(range(0, 40, 2))
        assert truth["phase_end"] == 39


def test_the_truth_of_a_moved_world_is_the_same_before_the_camera() -> None:
    shot, K, R, t = shots()[0], np.eye(3), SWING, np.array([0.0, 1.0, 4.0])
    segments = np.tile(SWING.T @ SWING.T, (len(shot.joints_m), 3, 1, 1))
    shot = replace(shot, segments=segments)
    moved = replace(shot, R_common_from_scene=SWING.T, t_common=np.array([1.0, 2.0, 3.0]))
    in_camera = []
    for one in (shot, moved):
        parts = one.truth("v1", K, R, t)
        in_camera.append(parts["v1/joints"] @ parts["v1/R"].T + parts["v1/t"])
        assert (parts["v1/R"] @ parts["v1/segments"])[-1, 2] == pytest.approx(SWING.T)
    assert in_camera[1] == pytest.approx(in_camera[0])


def test_an_action_is_made_once_and_again_under_another_key(tmp_path: Path) -> None:
    folder = tmp_path / "sway"
    make_action(folder, "sway", shots, "fine_tuned", {}, "one")
    before = (folder / "action.yaml").stat().st_mtime_ns
    make_action(folder, "sway", shots, "fine_tuned", {}, "one")
    assert (folder / "action.yaml").stat().st_mtime_ns == before
    make_action(folder, "sway", shots, "generic", {}, "two")
    assert (folder / "action.yaml").stat().st_mtime_ns != before
    assert is_made(folder, "two")


def test_the_key_follows_the_choice_and_the_motion(tmp_path: Path) -> None:
    file = tmp_path / "motion.npz"
    file.write_bytes(b"one")
    before = action_key(["walk", 4], [file])
    assert action_key(["walk", 4], [file]) == before
    assert action_key(["walk", 3], [file]) != before
    file.write_bytes(b"two")
    assert action_key(["walk", 4], [file]) != before


def test_two_makings_are_the_same(tmp_path: Path) -> None:
    texts = []
    for name in ("a", "b"):
        make_action(tmp_path / name, "sway", shots, "generic", {}, "key")
        files = sorted(p for p in (tmp_path / name).rglob("*.json") if p.name != MADE)
        texts.append([p.read_text() for p in files])
    assert texts[0] == texts[1]


def test_the_truth_is_silent_about_a_stranger(tmp_path: Path) -> None:
    def with_stranger() -> list[inputs.CapturedVideo]:
        return [*shots(), replace(shots()[0], is_outlier=True)]

    make_action(tmp_path / "sway", "sway", with_stranger, "fine_tuned", {}, "key")
    assert [v.id for v in read_action(tmp_path / "sway").videos] == ["v1", "v2", "v3"]
    with np.load(tmp_path / "sway" / "truth.npz") as truth:
        assert {name.split("/")[0] for name in truth.files if "/" in name} == {"v1", "v2"}


def test_a_filmed_video_keeps_its_camera_and_detections(tmp_path: Path) -> None:
    xy = np.full((40, 18, 2), np.nan)
    xy[:, 2] = [300.0, 200.0]
    shown = inputs.RecordedView(np.eye(3), np.eye(3), np.array([0, 0, 5.0]), xy, (640, 480))
    make_action(
        tmp_path / "sway", "sway", lambda: [replace(shots()[0], recorded=shown)], "generic", {}, "k"
    )
    assert read_action(tmp_path / "sway").videos[0].size == (640, 480)
    people = read_openpose(tmp_path / "sway" / "keypoints" / "v1", "coco18").people
    assert people[3][0, 2].tolist() == [300.0, 200.0, 1.0]
    assert (people[3][0, [0, 1, 3], 2] == 0).all()
    with np.load(tmp_path / "sway" / "truth.npz") as truth:
        assert truth["v1/t"].tolist() == [0, 0, 5]


def test_absent_data_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(inputs.DATA_VARIABLE, str(tmp_path))
    with pytest.raises(WorkFailed, match=r"holds no \.npz file; put the data there or set IMOCAP_"):
        inputs.data_folder(tmp_path, "trials")


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"name": "dance"}, "expected one of protocol, trials, yoga, real, h36m"),
        ({"name": "trials", "detector": "x"}, "--detector: expected one of fine_tuned"),
        ({"name": "yoga", "videos": 5}, "--videos: expected 1 to 4, got 5"),
    ],
)
def test_a_wrong_choice_is_refused(choice: dict, message: str) -> None:
    with pytest.raises(WrongUse, match=message):
        inputs.Choice(**choice)


# --- stored scores, exit codes


@dataclass(frozen=True)
class Kept:
    """Stands for a stored artifact of one video."""

    digest: str
    key: str = "k"

    def decode(self, kind: type) -> SimpleNamespace:
        return SimpleNamespace(videos=[SimpleNamespace(frames=range(5))])


class Silent:
    """A display that shows nothing."""

    def __getattr__(self, name: str) -> object:
        return lambda *_: None


def test_a_finished_action_is_not_scored_again_until_an_artifact_changes(tmp_path, monkeypatch):
    digest, scored = ["one"], []
    how = ["made"]

    def run(job: object, display: object, stages: object) -> list[SimpleNamespace]:
        outcome = SimpleNamespace(
            stage="keypoints", how=how[0], stored=Kept(digest[0]), seconds=2.0
        )
        display.started("keypoints", [])  # type: ignore[attr-defined]
        display.finished(outcome)  # type: ignore[attr-defined]
        return [outcome]

    def stage_statuses(_: object) -> list[SimpleNamespace]:
        return [SimpleNamespace(stage="keypoints", stored=Kept(digest[0]))]

    def numbers(*_: object) -> dict:
        scored.append(digest[0])
        return {"oracle": {"pa_mpjpe_mm": 1.0}}

    monkeypatch.setattr(scoring.runner, "run", run)
    monkeypatch.setattr(scoring.runner, "stage_statuses", stage_statuses)
    monkeypatch.setattr(scoring, "_numbers", numbers)
    job = SimpleNamespace(
        action=SimpleNamespace(name="jump", truth_files=(), folder=tmp_path),
        settings=SimpleNamespace(seed=7),
        pipeline=SimpleNamespace(upstream=lambda stage: ["keypoints"]),
    )
    score_file, costs = tmp_path / "jump.json", tmp_path / "costs"
    first = scoring.score_action(job, Silent(), score_file, costs)
    assert first.costs["keypoints"].peak_gb > 0
    how[0] = "cached"
    assert scoring.score_action(job, Silent(), score_file, costs) == first
    assert scoring.cached_score(job, score_file) == first
    assert scored == ["one"]
    digest[0] = "two"
    assert scoring.cached_score(job, score_file) is None
    again = scoring.score_action(job, Silent(), score_file, costs)
    assert again.costs == first.costs  # what it cost when it was made
    score_file.write_text("{ half a file")
    assert scoring.score_action(job, Silent(), score_file, costs).of("oracle", "pa_mpjpe_mm") == 1.0
    assert scored == ["one", "two", "two"]


def test_a_run_of_one_action_keeps_the_table_of_the_others(tmp_path, monkeypatch):
    def scored(action: str) -> ActionScore:
        return ActionScore(action, 4, 9, {"after loop": {"mpjpe_scaled_mm": 40.0}}, {}, action)

    valid = {"walk": scored("walk"), "jump": None}
    monkeypatch.setattr(motion, "action_names", lambda root, choice: ["jump", "kick", "walk"])
    monkeypatch.setattr(motion, "chosen_names", lambda root, choice: ["kick"])
    monkeypatch.setattr(motion, "existing_job", lambda w, choice, name, sets: name)
    monkeypatch.setattr(motion, "cached_score", lambda job, score_file: valid[job])
    monkeypatch.setattr(motion, "one_action", lambda display, root, choice, name: scored(name))
    for name in valid:
        file = motion.score_path(inputs.Choice("trials").folder(tmp_path), name)
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("{}")
    benchmark, folder = motion.measure(
        Workspace(tmp_path), inputs.Choice("trials", only=("kick",)), Silent()
    )
    assert [score.action for score in benchmark.scores] == ["kick", "walk"]
    assert benchmark.missing == ["jump"]  # its numbers are of other code
    assert "code): jump.**" in (folder / "table.md").read_text()


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["benchmark", "dance"], 2, "'dance' is not one of"),
        (["benchmark", "trials", "--videos", "13"], 2, "--videos: expected 1 to 12, got 13"),
        (["benchmark", "trials"], 1, "the benchmark trials needs captured motion"),
        (["benchmark", "bones"], 1, "needs captured motion"),
        (["benchmark", "trials", "--variants", "tcc"], 2, "only for `imocap benchmark ablations`"),
        (["benchmark", "ablations", "--videos", "2"], 2, "ablations set --detector and --videos"),
        (["benchmark", "ablations", "--jobs", "0"], 2, "--jobs"),
        (["benchmark", "h36m"], 2, "--data: the benchmark h36m needs the folder"),
        (["benchmark", "h36m", "--data", "."], 1, "data_3d_h36m.npz does not exist"),
    ],
)
def test_exit_codes(words, code, message, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv(inputs.DATA_VARIABLE, str(tmp_path))
    assert main(["--root", str(tmp_path), *words]) == code
    assert message in capsys.readouterr().err


def summary(reference: str = "b") -> SyncSummary:
    maps = [SyncMap(id=i, reference_frame=np.zeros(n), confidence=np.ones(n)) for i, n in LENGTHS]
    return SyncSummary(
        reference=reference, ids=[i for i, _ in LENGTHS], lengths=[n for _, n in LENGTHS],
        maps=maps, method="softmap", centrality=np.ones(2), status="",
    )  # fmt: skip


LENGTHS = [("a", 4), ("b", 3)]


def known_truth() -> Truth:
    def video(phase: list[float], R: np.ndarray, t: list[float]) -> VideoTruth:
        return VideoTruth(None, (), np.eye(3), R, np.array(t), np.array(phase))

    a = video([0.0, 1.0, 2.0, 9.0], SWING, [0.0, 0.0, 4.0])
    return Truth({"a": a, "b": video([0.0, 2.0, 4.0], np.eye(3), [1.0, 0.0, 3.0])}, 4.0)


def test_the_oracle_s_frames_are_where_phases_are_equal() -> None:
    wrong = summary().model_copy(update={"excluded": ["a"], "mirrored": ["a"]})
    sync = true_sync(wrong, known_truth())
    assert (sync.excluded, sync.mirrored) == ([], [])
    assert sync.maps[0].reference_frame[:3].tolist() == [0.0, 0.5, 1.0]
    assert np.isnan(sync.maps[0].reference_frame[3])
    assert sync.maps[0].confidence.tolist() == [1, 1, 1, 0]
    assert sync.maps[1].reference_frame.tolist() == [0, 1, 2]


def test_the_oracle_s_cameras_see_a_world_point_where_the_true_ones_do() -> None:
    truth = known_truth()
    cameras = true_cameras(true_sync(summary(), truth), truth)
    point = np.array([0.3, -0.2, 0.5])
    in_reference = point + [1.0, 0.0, 3.0]
    assert torch.equal(cameras.R[1], torch.eye(3, dtype=torch.float64))
    in_camera = cameras.R[0].numpy() @ in_reference + cameras.t[0].numpy()
    assert in_camera == pytest.approx(SWING @ point + [0.0, 0.0, 4.0])


@pytest.fixture(scope="module")
def three_views() -> Made:
    return scene(FRAMES, TURNS_DEG, np.random.default_rng(5))


def test_the_oracle_s_fit_leaves_the_cameras_alone(three_views: Made) -> None:
    scene, true = whole(three_views), in_own_axes(three_views)
    cameras = three_views.cameras()
    start = replace(true, trans=true.trans + 0.05)
    fitted = fit_with_cameras(scene, start, cameras, replace(OPTIONS, max_steps=3))
    assert torch.equal(fitted.cameras.R, cameras.R)
    assert torch.equal(fitted.cameras.t, cameras.t)
    assert mpjpe_mm(three_views.body, fitted.state, true) < 10


def test_the_oracle_of_one_video_is_its_monocular_fit(three_views: Made) -> None:
    true = in_own_axes(three_views)
    alone = replace(whole(three_views), observations=three_views.observations[:1])
    cameras = three_views.cameras(1)
    start = true.rows(torch.tensor([0]))
    assert fit_with_cameras(alone, start, cameras, OPTIONS).state is start


def test_true_cameras_tell_how_large_somebody_is() -> None:
    """Cameras 8 % farther apart and farther away see the same of a body 8 % larger."""
    seen = scene(FRAMES, [0.0, 90.0, 180.0, -90.0], np.random.default_rng(5))
    given, cameras, truth = whole(seen), seen.cameras(), in_own_axes(seen)
    given = replace(given, fit=replace(given.fit, size_prior=1e5))
    apart = replace(cameras, t=1.08 * cameras.t)
    start = replace(truth, trans=1.08 * truth.trans)
    found = fit_with_cameras(given, start, apart, OPTIONS)
    joints = seen.body.model.shape(found.state.betas[:1]).joints_rest[0]
    limbs = [(1, 4), (4, 7), (2, 5), (5, 8), (16, 18), (18, 20), (17, 19), (19, 21)]
    mean = seen.body.model.joints_template
    grown = [float((joints[a] - joints[b]).norm() / (mean[a] - mean[b]).norm()) for a, b in limbs]
    assert np.mean(grown) == pytest.approx(1.08, abs=0.02)

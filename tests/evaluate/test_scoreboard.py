"""Rows of the cameras' errors: values where the truth has them, else the reason."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from imocap_core.artifacts.schemas import Camera, Evaluate, Hands, SyncSummary
from imocap_core.body import Posed, load_free_body
from imocap_core.conventions import EVAL_12, SMPL_JOINTS
from imocap_core.evaluate.scoreboard import FOCAL, PLACE, ROTATION, camera_rows
from imocap_core.evaluate.whole_body_scores import VertexErrors, measure_surfaces, surface_edges
from imocap_core.io.truth import Truth, VideoTruth
from imocap_core.pipeline.stage import Inputs
from imocap_core.report.table_files import read_contents
from stages.evaluate import run
from tests.report.made import Made

IDS = ("v1", "v2", "v3", "v4")
K = np.array([[600.0, 0, 320], [0, 600, 180], [0, 0, 1]])
R = Rotation.random(4, random_state=0).as_matrix()
T = np.random.default_rng(0).normal(size=(4, 3))
WORLD = Rotation.random(random_state=1).as_matrix()  # the result's axes from the truth's
TRUTH = Truth(
    {
        i: VideoTruth(joints=None, joint_names=(), K=K, R=R_, t=t, phase=None)
        for i, R_, t in zip(IDS, R, T, strict=True)
    },
    phase_end=1.0,
)
CAMERAS = [  # of another size, with axes and an origin of its own
    Camera(id=i, K=K * [[1.02], [1.02], [1]], R=R_ @ WORLD.T, t=0.7 * t + R_ @ [1.0, 2.0, 3.0])
    for i, R_, t in zip(IDS, R, T, strict=True)
]


def values(cameras: list[Camera], truth: Truth | None, **sync: list[str]) -> dict:  # type: ignore[type-arg]
    summary = SyncSummary.model_construct(
        reference="v1", **({"excluded": [], "mirrored": []} | sync)
    )
    rows = camera_rows("after loop", cameras, summary, truth)
    return {(row.video, row.metric): (row.value, row.note) for row in rows}


def test_places_are_scored_in_any_world_and_focal_lengths_by_their_ratio() -> None:
    found = values(CAMERAS, TRUTH)
    for i in IDS:
        assert found[i, PLACE][0] == pytest.approx(0, abs=1e-6)
        assert found[i, FOCAL][0] == pytest.approx(100 * np.log(1.02))
    assert ("v1", ROTATION) not in found  # the reference has no error by definition
    assert found["v3", ROTATION][0] == pytest.approx(0, abs=1e-4)


def test_what_is_not_scored_has_a_reason() -> None:
    two = values(CAMERAS[:2], TRUTH)
    assert two["v2", PLACE] == (None, "places are compared from 3 cameras on")
    without = replace(TRUTH, videos={i: replace(v, t=None) for i, v in TRUTH.videos.items()})
    for truth in (None, without):
        assert values(CAMERAS, truth)["v2", PLACE] == (None, "the true cameras are not known")
    left_out = values(CAMERAS, TRUTH, excluded=["v4"])
    assert left_out["v4", ROTATION] == (None, "excluded")
    assert ("v4", PLACE) not in left_out
    assert left_out["v2", PLACE][0] == pytest.approx(0, abs=1e-6)


NO_HANDS = Hands(videos=[], model="", model_digest="", size=1.0, status="no hand keypoints")


def evaluate(folder: Path, made: Made, *, truth: bool, figures: bool = False) -> Evaluate:
    file = folder / "truth.npz"
    if truth:
        made.write_truth(file)
    return evaluate_with(folder, made, file if truth else None, figures)


def evaluate_with(folder: Path, made: Made, truth: Path | None, figures: bool = False) -> Evaluate:
    """With the truth of a file; the report goes into the folder `r`."""
    (report := folder / "r").mkdir()
    given = (made.keypoints, made.camera_motion, made.initial, made.sync, made.single)
    given = (*given, made.refined, made.claimed, made.again, NO_HANDS)
    inputs = Inputs("evaluate", {}, {type(artifact): artifact for artifact in given})
    context = SimpleNamespace(
        device="cpu", report=report, progress=lambda *_: None, truth=lambda: truth,
        action_file=lambda: folder / "action.yaml", video=lambda _: None,
    )  # fmt: skip
    return run(context, inputs, SimpleNamespace(evaluate=SimpleNamespace(figures=figures)))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of the scored result."""
    return tmp_path_factory.mktemp("scored")


@pytest.fixture(scope="module")
def scored(made: Made, folder: Path) -> Evaluate:
    return evaluate(folder, made, truth=True)


def _values(result: Evaluate, answer: str, metric: str) -> dict[str, float | None]:
    every = next(t for t in result.tables if t.name == "metrics")
    return {r[1]: r[3] for r in every.rows if r[0] == answer and r[2] == metric}  # type: ignore[misc]


def test_scores_agree_with_what_was_made(scored: Evaluate) -> None:
    result = scored
    mono = _values(result, "monocular", "mpjpe_mm")["all videos"]
    last = _values(result, "after loop", "mpjpe_mm")["all videos"]
    assert last == pytest.approx(mono / 5, rel=0.1)  # a fifth of the bend
    assert _values(result, "single pass", "sync_error_frames")["v2"] == pytest.approx(1)
    assert _values(result, "after loop", "sync_error_frames")["v3"] == pytest.approx(0)
    cameras = _values(result, "after loop", "camera_rotation_error_deg")
    assert cameras["v2"] == pytest.approx(0, abs=1e-4)
    assert "v1" not in cameras  # the reference has no error by definition
    rounds = next(t for t in result.tables if t.name == "rounds")
    assert [row[1] for row in rounds.rows] == [False, True]
    assert "sync_error_frames" in rounds.columns
    assert rounds.rows[1][rounds.columns.index("sync_error_frames")] == pytest.approx(0)
    assert (_values(result, "monocular", "reprojection_px")["v1"] or 0) > 0.2


def test_the_whole_body_is_scored(scored: Evaluate) -> None:
    result = scored

    def over_videos(answer: str, metric: str) -> float:
        value = _values(result, answer, metric)["all videos"]
        assert value is not None, metric
        return value

    bent_deg = np.degrees(0.25)  # at four of 24 joints, none in the spine
    assert over_videos("monocular", "mpjae_deg") == pytest.approx(4 * bent_deg / 24)
    assert over_videos("after loop", "mpjae_deg") == pytest.approx(4 * bent_deg / 5 / 24)
    for metric in ("mpjpe_24_mm", "pve_mm", "pa_pve_mm", "w_mpjpe_mm", "wa_mpjpe_mm"):
        assert 0 < over_videos("after loop", metric) < 0.3 * over_videos("monocular", metric)
    joints = next(t for t in result.tables if t.name == "joints")
    assert joints.columns == ["joint", "monocular_mm", "single_pass_mm", "after_loop_mm"]
    assert [row[0] for row in joints.rows] == list(SMPL_JOINTS)
    turned = {r[0]: r[1] for t in result.tables if t.name == "joint_rotations" for r in t.rows}
    assert turned["left_elbow"] == pytest.approx(bent_deg)
    assert turned["neck"] == pytest.approx(0, abs=1e-6)
    summary = next(t for t in result.tables if t.name == "summary")
    assert summary.columns.index("reprojection_px") < summary.columns.index("mpjpe_24_mm")
    assert {"pve_mm", "rte_pct", "sync_error_ms"} <= {*summary.columns}


def test_a_truth_of_another_body_model_leaves_its_surface_unscored(made, tmp_path):
    made.write_truth(tmp_path / "full.npz")
    with np.load(tmp_path / "full.npz") as full:
        np.savez(tmp_path / "other.npz", **{**full, "model": np.array("another 123")})
    result = evaluate_with(tmp_path, made, tmp_path / "other.npz")
    assert _values(result, "after loop", "pve_mm")["all videos"] is None
    assert _values(result, "after loop", "mpjae_deg")["all videos"] is not None
    assert _values(result, "after loop", "stretched_edges_pct")["all videos"] is not None


def test_without_truth_the_reasons_are_given_and_images_still_scored(made, tmp_path):
    result = evaluate(tmp_path, made, truth=False)
    unscored = next(t for t in result.tables if t.name == "unscored")
    assert ["mpjpe_mm", "no truth"] in unscored.rows
    assert ["pve_mm", "no truth"] in unscored.rows
    assert _values(result, "after loop", "stretched_edges_pct")["all videos"] is not None
    assert ["sync_error_pct", "no true phases"] in unscored.rows
    assert ["camera_rotation_error_deg", "the true cameras are not known"] in unscored.rows
    assert _values(result, "after loop", "reprojection_px")["all videos"] is not None
    assert _values(result, "after loop", "cycle_residual_frames")["all videos"] is not None


@pytest.mark.long
def test_one_video_alone_has_poses_and_no_synchronisation(tmp_path: Path) -> None:
    result = evaluate(tmp_path, Made(count=1, frames=6), truth=True, figures=True)
    assert _values(result, "after loop", "mpjpe_mm")["v1"] is not None
    assert not any(t.name == "sync" for t in result.tables)
    assert "warp.png" not in result.files
    assert "moments.webp" in result.files


def test_claims_are_held_against_the_errors(scored: Evaluate, folder: Path) -> None:
    result = scored
    joints = next(t for t in result.tables if t.name == "uncertainty_joints")
    row = next(r for r in joints.rows if r[0] == "left_ankle")
    ankle = dict(zip(joints.columns, row, strict=True))
    assert ankle["sigma_mm"] == pytest.approx(20)
    assert ankle["normalised_error"] == pytest.approx(ankle["error_mm"] / 20)
    values = _values(result, "after loop", "normalised_error")
    every = [r[3] for r in joints.rows if r[0] in EVAL_12]
    expected = np.sqrt(np.mean(np.square(np.array(every, dtype=float))))
    assert values["all videos"] == pytest.approx(expected, rel=0.02)
    assert "made" in (folder / "r" / "observability.md").read_text()
    assert any(t.title == "Observability" for t in result.tables)


@pytest.mark.long
def test_report_is_whole_and_repeats_itself(made, scored, folder, tmp_path):
    first, report = evaluate(tmp_path, made, truth=True, figures=True), tmp_path / "r"
    assert sorted(p.name for p in report.iterdir()) == first.files
    pictures = {picture.file for picture in read_contents(report).pictures}
    for name in ("warp.png", "affinity.png", "scene.png", "overlay_v2.webp", "body_v1.webp"):
        assert name in first.files
        assert name in pictures
        assert (report / name).stat().st_size > 5000
    assert first.tables == scored.tables
    assert (report / "metrics.csv").read_text() == (folder / "r" / "metrics.csv").read_text()


def test_truth_of_another_length_is_refused_by_name(made: Made, tmp_path: Path) -> None:
    Made(frames=9).write_truth(tmp_path / "truth.npz")
    with pytest.raises(ValueError, match=r"16 used frames, got 9 rows"):
        evaluate_with(tmp_path, made, tmp_path / "truth.npz")


def test_a_missing_camera_leaves_poses_unscored_but_not_sync(made: Made, tmp_path: Path) -> None:
    made.write_truth(tmp_path / "full.npz")
    with np.load(tmp_path / "full.npz") as full:
        np.savez(tmp_path / "part.npz", **{k: full[k] for k in full if not k.endswith("/R")})
    result = evaluate_with(tmp_path, made, tmp_path / "part.npz")
    assert _values(result, "after loop", "mpjpe_mm") == dict.fromkeys(
        [*made.ids, "all videos"], None
    )
    assert _values(result, "after loop", "sync_error_frames")["v2"] == pytest.approx(0)


@pytest.mark.long
def test_a_video_without_any_match_leaves_the_report_whole(tmp_path: Path) -> None:
    made = Made(count=2, frames=6)
    lost = made.refined.sync.maps[1]
    none = lost.model_copy(update={"reference_frame": lost.reference_frame * np.nan})
    sync = made.refined.sync.model_copy(update={"maps": [made.refined.sync.maps[0], none]})
    made.refined = made.refined.model_copy(update={"sync": sync})
    result = evaluate(tmp_path, made, truth=True, figures=True)
    assert _values(result, "after loop", "sync_error_frames")["v2"] is None
    assert _values(result, "after loop", "matched_share")["v2"] == 0
    assert "warp.png" in result.files


def test_a_turned_hand_is_an_error_of_the_surface_and_no_error_against_itself() -> None:
    model = load_free_body()
    rest = torch.eye(3, dtype=model.dtype).expand(2, 24, 3, 3).contiguous()
    turned = rest.clone()
    wrist = model.joint_names.index("left_wrist")
    turned[:, wrist] = torch.tensor([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]], dtype=model.dtype)
    still = torch.zeros(2, 3, dtype=model.dtype)
    shaped = model.shape(torch.zeros(model.num_betas, dtype=model.dtype))
    assert _errors_mm(shaped.pose(turned, still), shaped.pose(rest, still)).pve > 5
    assert _errors_mm(shaped.pose(turned, still), shaped.pose(turned, still)).pve == 0


def _errors_mm(predicted: Posed, true: Posed) -> VertexErrors:
    edges = surface_edges(predicted.shaped.model)
    alone = measure_surfaces([predicted], None, edges)[0]
    first, second = measure_surfaces([predicted, true], true, edges)
    assert alone.errors is None
    np.testing.assert_array_equal(alone.stretched_shares, first.stretched_shares)
    assert second.errors.pve == 0
    return first.errors

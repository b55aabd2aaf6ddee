"""The demo action, whole: no number lost, the promises kept, a planted fault seen."""

import json
import shutil
from pathlib import Path

import pytest

from imocap_core.artifacts.store import Store
from imocap_core.conventions import EVAL_12
from tests.regression.comparison import Baseline, compare, lost, table
from tests.regression.measure import MADE, Scored, run_pipeline

pytestmark = pytest.mark.regression

# Each video matched to the reference on its own, once: what a broken agreement between the videos
# and a loop that does nothing would leave.
FAULT = ("sync.consensus_rounds=0", "refine.max_rounds=0", "motion.objective=paper")


def test_no_metric_lost(yoga: Scored, baseline: Baseline) -> None:
    losses = lost(compare(baseline, MADE, yoga.summary()))
    assert not losses, f"worse than the baseline (docs/regression.md):\n{table(losses)}"


def test_videos_are_in_step(yoga: Scored) -> None:
    after = yoga.summary()["after loop"]
    assert after["sync_error_pct"] <= 0.8
    assert after["matched_share"] >= 0.9  # an error over few matches would say little


def test_several_videos_are_much_better_than_one_and_the_loop_helps(yoga: Scored) -> None:
    found = {result: row["mpjpe_mm"] for result, row in yoga.summary().items()}
    assert found["after loop"] <= 0.7 * found["monocular"]
    assert found["after loop"] <= found["single pass"]


def test_every_camera_is_found(yoga: Scored) -> None:
    degrees = yoga.by_video("after loop", "camera_rotation_error_deg")
    assert len(degrees) == 3  # all but the reference
    assert max(degrees.values()) <= 6.0, degrees


def test_claimed_uncertainty_is_honest(yoga: Scored, root: Path) -> None:
    """Normalised errors within a factor of two: of every video, and of every joint."""
    by_video = yoga.by_video("after loop", "normalised_error")
    assert len(by_video) == 4
    assert all(0.5 <= value <= 2.0 for value in by_video.values()), by_video
    report = root / "artifacts" / MADE / "report" / "metrics.json"
    joints = json.loads(report.read_text(encoding="utf-8"))["uncertainty_joints"]
    by_joint = {row["joint"]: row["normalised_error"] for row in joints}
    assert len(by_joint) == 24
    assert all(0.5 <= value <= 2.0 for value in (by_joint[name] for name in EVAL_12)), by_joint


def test_a_planted_fault_fails(
    yoga: Scored, root: Path, tmp_path: Path, baseline: Baseline
) -> None:
    """The real pipeline with a real fault, in a copy of the run's folder."""
    with Store(root / "artifacts").lock(MADE, lambda: None):  # while no other worker writes there
        for part in ("actions", "artifacts"):
            shutil.copytree(root / part, tmp_path / part)
    broken = run_pipeline(tmp_path, MADE, FAULT)
    losses = {(v.result, v.metric) for v in lost(compare(baseline, MADE, broken.summary()))}
    assert {("after loop", "sync_error_pct"), ("after loop", "mpjpe_mm")} <= losses
    assert not any(result == "monocular" for result, _ in losses)  # before the fault

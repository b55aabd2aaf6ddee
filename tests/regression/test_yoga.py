"""The demo action, whole: no number lost, the promises kept, a planted fault seen."""

import json
import shutil
from pathlib import Path

import pytest

from imocap_core.artifacts.schemas import InitialSmpl, RefineSync, Uncertainty
from imocap_core.artifacts.store import Store
from imocap_core.conventions import EVAL_12
from tests.pipeline.stored import publish
from tests.regression.comparison import Baseline, compare, lost, table
from tests.regression.measure import MADE, Scored, run_pipeline

pytestmark = pytest.mark.regression

LATE_FRAMES = 10


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


def test_a_planted_fault_fails(yoga, root, tmp_path, baseline):
    """A loop that leaves each video's own motion, and matches that come late, in a copy of the
    run's folder: the real pipeline scores them."""
    with Store(root / "artifacts").lock(MADE, lambda: None):  # while no other worker writes there
        for part in ("actions", "artifacts"):
            shutil.copytree(root / part, tmp_path / part)
    store = Store(tmp_path / "artifacts")
    kinds = {"refine_sync": RefineSync, "initial_smpl": InitialSmpl, "uncertainty": Uncertainty}
    refined, initial, claimed = (store.load(MADE, s).decode(kind) for s, kind in kinds.items())
    late = [
        m if m.id == refined.sync.reference
        else m.model_copy(update={"reference_frame": m.reference_frame + LATE_FRAMES})
        for m in refined.sync.maps
    ]  # fmt: skip
    sync = refined.sync.model_copy(update={"maps": late})
    motion = refined.motion.model_copy(update={"videos": initial.videos})
    fault = refined.model_copy(update={"sync": sync, "motion": motion})
    for stage, artifact in (("refine_sync", fault), ("uncertainty", claimed)):
        publish(tmp_path, MADE, stage, artifact)
    losses = lost(compare(baseline, MADE, run_pipeline(tmp_path, MADE).summary()))
    names = {(v.result, v.metric) for v in losses}
    assert {("after loop", "sync_error_pct"), ("after loop", "mpjpe_mm")} <= names
    assert {result for result, _ in names} == {"after loop"}  # where the fault is

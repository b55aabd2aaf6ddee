"""The trust benchmark on two made actions: what is planted is what is counted."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from imocap_core.conventions import EVAL_14
from stages.benchmarks.trust import TrustRow, measure, totals
from stages.harness.pipeline import read_pipeline
from stages.params import Params, SyncParams

REST = {
    "ankle": (0.1, 0.0, 0.1), "knee": (0.1, 0.0, 0.5), "hip": (0.1, 0.0, 0.9),
    "wrist": (0.6, 0.0, 1.1), "elbow": (0.4, 0.0, 1.2), "shoulder": (0.2, 0.0, 1.4),
    "neck": (0.0, 0.0, 1.45), "head": (0.0, 0.0, 1.65),
}  # fmt: skip


def write_action(file: Path, moved: tuple[str, ...], rng: np.random.Generator) -> None:
    """Four trials of 90 frames in which some joints swing widely and not back."""
    phase = np.linspace(0.0, 3.0, 90)
    rest = np.array([REST[n.split("_")[-1]] for n in EVAL_14])
    rest[[n.startswith("right") for n in EVAL_14], 0] *= -1
    swing = rng.normal(0.0, 0.35, (2, 14, 3)) * np.array([n in moved for n in EVAL_14])[:, None]
    trials = {}
    for v in range(4):
        at = phase + 0.1 * np.sin(phase + v)
        joints = rest + swing[0] * np.sin(at)[:, None, None] + swing[1] * at[:, None, None] / 2
        trials[f"trial_{v:02d}"] = joints.astype(np.float32)
    index, fps = np.arange(14), np.float64(30.0)
    np.savez(file, common14_idx=index, fps=fps, trial_ids=np.array(list("abcd")), **trials)


def params() -> SyncParams:
    pipeline = read_pipeline(Path(__file__).parents[2] / "pipeline.yaml", Params)
    return SyncParams.model_validate(pipeline.defaults["sync"])


def test_planted_faults_of_very_different_actions_are_found(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    write_action(tmp_path / "reach.npz", ("left_wrist", "left_elbow", "head"), rng)
    write_action(tmp_path / "kick.npz", ("right_ankle", "right_knee", "left_ankle"), rng)
    rows = measure(tmp_path, params())
    assert [r.action for r in rows] == ["kick", "reach"]
    assert all(r.clean == "-" for r in rows)
    assert all(r.found_mirrored == r.mirrored for r in rows)
    assert all(r.outlier_score > r.clean_score for r in rows)
    assert measure(tmp_path, params()) == rows


def test_only_the_right_video_alone_counts_as_found() -> None:
    good = TrustRow("a", "-", "v2 b", "v2", "v3", "v3", 1.2, 1.0, 0.2, -0.1)
    bad = TrustRow("a", "v1", "v2 b", "v2 v3", "v3", "-", 1.2, 1.0, 0.2, -0.1)
    said = totals([good, bad])
    assert [line.rsplit(": ", 1)[1] for line in said] == ["1 of 2", "1 of 2", "1 of 2"]

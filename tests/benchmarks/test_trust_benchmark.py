"""The trust benchmark on made actions: what is planted is what is counted."""

from __future__ import annotations

import numpy as np

from benchmarks.trust.screened import PoseVideos, TrustRow, among_decidable, measure, totals
from imocap_core.conventions import EVAL_14, mirror_indices

REST = {
    "ankle": (0.1, 0.0, 0.1), "knee": (0.1, 0.0, 0.5), "hip": (0.1, 0.0, 0.9),
    "wrist": (0.6, 0.0, 1.1), "elbow": (0.4, 0.0, 1.2), "shoulder": (0.2, 0.0, 1.4),
    "neck": (0.0, 0.0, 1.45), "head": (0.0, 0.0, 1.65),
}  # fmt: skip


def made_action(moved: tuple[str, ...], rng: np.random.Generator) -> PoseVideos:
    """Four performances of 90 frames in which some joints swing widely and not back."""
    phase = np.linspace(0.0, 3.0, 90)
    rest = np.array([REST[n.split("_")[-1]] for n in EVAL_14])
    rest[[n.startswith("right") for n in EVAL_14], 0] *= -1
    swing = rng.normal(0.0, 0.35, (2, 14, 3)) * np.array([n in moved for n in EVAL_14])[:, None]
    poses = []
    for v in range(4):
        times = phase + 0.1 * np.sin(phase + v)
        joints = (
            rest + swing[0] * np.sin(times)[:, None, None] + swing[1] * times[:, None, None] / 2
        )
        poses.append(joints + 0.01 * rng.normal(size=joints.shape))
    return PoseVideos(poses, [30.0] * 4, tuple(mirror_indices(EVAL_14)))


def test_planted_faults_of_very_different_actions_are_found() -> None:
    rng = np.random.default_rng(4)
    actions = {
        "reach": made_action(("left_wrist", "left_elbow", "head"), rng),
        "kick": made_action(("right_ankle", "right_knee", "left_ankle"), rng),
    }
    rows = measure(actions, 4.0)
    assert [r.action for r in rows] == ["kick", "reach"]
    assert all(r.clean == "-" for r in rows)
    assert all(r.found_mirrored == r.mirrored for r in rows)
    assert all(r.found_outliers == r.replaced.split(" ")[0] for r in rows)
    assert all(r.outlier_score > r.clean_score for r in rows)
    assert measure(actions, 4.0) == rows


def test_only_the_right_video_alone_counts_as_found() -> None:
    good = TrustRow("a", "-", "-", "v2 b", "v2", "v3", "v3", "v3", 1.2, 1.0, 0.2, -0.1)
    bad = TrustRow("a", "v1", "v1", "v2 b", "v2 v3", "v3", "-", "-", 1.2, 1.0, 0.2, -0.1)
    lines = totals([good, bad], "fits")
    assert [line.rsplit(": ", 1)[1] for line in lines] == ["1 of 2"] * 5
    assert all(line.startswith("fits: ") for line in lines)
    # what the true poses don't decide is nobody's fault
    able = among_decidable([good, bad], [good, bad])
    assert [line.rsplit(": ", 1)[1] for line in able] == ["1 of 1", "1 of 1", "0 of 1"]
    missed = among_decidable([bad], [good])
    assert [line.rsplit(": ", 1)[1] for line in missed] == ["0 of 1", "0 of 1", "1 of 1"]

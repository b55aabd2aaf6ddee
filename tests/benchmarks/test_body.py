"""The measurements behind `imocap benchmark bones`: they run, and recover what was put in."""

from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.body import bones
from imocap_core.body import load_free_body
from imocap_core.conventions import EVAL_12


def test_fitted_bones_match_a_skeleton_of_the_same_family(tmp_path: Path) -> None:
    model = load_free_body()
    betas = np.random.default_rng(0).normal(size=10)
    joints = model.shape(torch.as_tensor(betas)).joints_rest.numpy()
    names = list(EVAL_12)
    xyz = joints[[model.joint_names.index(name) for name in names]]
    short = [n.replace("left_", "l_").replace("right_", "r_") for n in names]
    np.savez(
        tmp_path / "made.npz",
        trial_00=np.broadcast_to(xyz, (5, 12, 3)),
        common14=np.array(short),
        common14_idx=np.arange(12),
    )
    (row,) = bones.measure(tmp_path)
    assert row.skeleton == "made"
    assert row.largest_mm < 0.5
    assert row.unfitted_mm > 5


def test_slopes_of_bone_lengths_equal_finite_differences() -> None:
    model = load_free_body()
    betas = np.random.default_rng(1).normal(size=10)
    _, slope = bones.bone_lengths(model, betas)
    for b, step in enumerate(1e-5 * np.eye(10)):
        ahead, behind = (bones.bone_lengths(model, betas + s * step)[0] for s in (1, -1))
        assert slope[:, b] == pytest.approx((ahead - behind) / 2e-5, abs=1e-8)

"""Modes in the joint solve: two styles of one action come apart, and none is made of noise."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from imocap_core.motion.multiview import modes
from imocap_core.motion.multiview.scene import Scene, consensus_motion
from imocap_core.motion.multiview.smpl_ba import solve_jointly
from imocap_core.motion.state import MotionState
from imocap_core.rotations import exp
from tests.motion.made import FRAMES, Made, filmed, mpjpe_mm, scene
from tests.motion.test_smpl_ba import OPTIONS, disturbed, in_own_axes, whole

RAISED = torch.zeros(6, 1, 24, 3, dtype=torch.float64)  # a left arm, in three of six videos
RAISED[[[1], [2], [5]], 0, [16, 18]] = torch.tensor([0.0, 0.25, 0.35], dtype=torch.float64)


def in_styles(raised: float) -> tuple[Made, Scene, MotionState]:
    """Six videos in two styles; their scene, and the true motions in their cameras' axes."""
    made = scene(FRAMES, [0, 60, -60, 120, -120, 180], np.random.default_rng(2))
    truth = in_own_axes(made)
    truth = replace(truth, R_local=truth.R_local @ exp(raised * RAISED))
    videos = filmed(made, truth, np.random.default_rng(3))
    return made, whole(replace(made, observations=videos)), truth


def shifts_of(made: Made, *given: Scene | MotionState) -> np.ndarray | None:
    mean = consensus_motion(*given, made.cameras())
    return modes.mode_shifts(*given, made.cameras(), mean)


def test_a_second_style_is_the_one_mode() -> None:
    made, *given = in_styles(1.0)
    (size,) = np.linalg.norm(shifts_of(made, *given), axis=-1).mean(1)  # (P,)
    arm = np.isin(made.body.keypoints.names, ["left_elbow", "left_wrist"])
    assert size[arm].min() > 0.03
    assert size[~arm].max() < 0.02


def test_performances_that_differ_by_chance_have_none() -> None:
    made, filmed, truth = in_styles(0.0)
    chance = np.random.default_rng(5).normal(0, 0.03, truth.R_local.shape[:-1])
    state = replace(truth, R_local=truth.R_local @ exp(torch.as_tensor(chance)))
    assert shifts_of(made, filmed, state) is None


def test_motions_are_better_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    made, filmed, truth = in_styles(0.5)
    first, errors = solve_jointly(filmed, disturbed(truth, 0.05), OPTIONS), []
    for least in (5, 7):
        monkeypatch.setattr(modes, "LEAST_SOLVED", least)
        again = solve_jointly(filmed, first.state, OPTIONS, cameras=first.cameras)
        errors.append(mpjpe_mm(made.body, again.state, truth))
    assert errors[0] < 0.95 * errors[1]

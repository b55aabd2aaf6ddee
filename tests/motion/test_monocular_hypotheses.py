"""The distinct motions of one video: reversals of the best fit, refitted, cheapest first."""

from __future__ import annotations

from itertools import combinations, pairwise

import numpy as np
import pytest
import torch

from imocap_core.motion.monocular.fit import fit_monocular
from imocap_core.motion.monocular.hypotheses import DISTINCT_M, alternatives, reversed_starts
from imocap_core.motion.monocular.starts import Library, make_library, start_at_joints
from imocap_core.motion.prior import load_pose_prior
from imocap_core.motion.state import TWINS, MotionState
from tests.motion.made import WEIGHTS, Made, scene

DEPTH = torch.tensor([1.0, 1.0, -1.0], dtype=torch.float64)


@pytest.fixture(scope="module")
def made() -> Made:
    return scene(18, [0.0, 1.0], np.random.default_rng(3))


@pytest.fixture(scope="module")
def library(made: Made) -> Library:
    rng = np.random.default_rng(0)
    return make_library(made.body, load_pose_prior(), rng, poses=100, directions=8)


def about_root(made: Made, motion: MotionState) -> torch.Tensor:
    xyz = made.body.positions(made.body.joints, motion).xyz[0]
    return xyz - xyz[:, :1]


def test_reversed_sides_are_the_reflection_in_depth(made: Made, library: Library) -> None:
    motion = made.state.of_motion(0, 18)
    motion = MotionState.of(
        motion.R_local, motion.trans, torch.zeros_like(motion.betas), motion.valid
    )
    start = reversed_starts(made.body, library, motion, made.observations[0])["sides"]
    other = MotionState.of(start.R_local[None], start.trans[None], motion.betas, motion.valid)
    reflected = about_root(made, motion)[:, TWINS] * DEPTH
    apart = (about_root(made, other) - reflected).norm(dim=-1)
    assert float(apart.max()) < 0.03  # the body is symmetric to within that


def test_alternatives_are_distinct_and_in_order_of_cost(made: Made, library: Library) -> None:
    prior, observations = load_pose_prior(), made.observations[:2]
    starts = [[start_at_joints(made.body, made.state.R_local[0], o)] for o in observations]
    fit = fit_monocular(made.body, prior, observations, starts, WEIGHTS, stride=3, max_steps=4)
    found = alternatives(
        made.body, prior, library, observations, fit.coarse, WEIGHTS, videos=[1], count=3
    )
    assert found[0] == []
    assert 1 <= len(found[1]) <= 3
    costs = [h.cost for h in found[1]]
    assert all(a <= b for a, b in pairwise(costs))
    poses = [about_root(made, h.motion) for h in found[1]]
    poses.append(about_root(made, fit.state.of_motion(1, 18)))
    assert all(pose.shape == (18, 24, 3) for pose in poses)
    apart = [float((a - b).norm(dim=-1).mean()) for a, b in combinations(poses, 2)]
    assert min(apart) > 0.7 * DISTINCT_M  # measured on every third frame, before the last fit

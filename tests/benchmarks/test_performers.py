"""A body takes over a captured performer's limbs and trunk."""

import numpy as np
import torch

from benchmarks.synthetic.performers import BONES, limb_lengths_m, perform, shape_of_limbs
from imocap_core.body import load_free_body
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.rotations import exp, log
from tests.benchmarks.test_retargeting import (
    WORLD_FROM_BODY,
    captured,
    performed,
    stance_and_skeleton,
)


def test_a_shape_has_the_limbs_that_were_asked_for() -> None:
    model = load_free_body()
    betas = torch.zeros(10, dtype=torch.float64)
    betas[0], betas[1] = -1.0, 0.8
    rest = model.shape(betas).joints_rest
    place = {name: rest[SMPL_JOINTS.index(f"left_{name}")] for name in (*BONES, *BONES.values())}
    lengths = {far: float((place[far] - place[near]).norm()) for far, near in BONES.items()}
    shaped = model.shape(shape_of_limbs(model, lengths)).joints_rest
    for far, near in BONES.items():
        ends = [shaped[SMPL_JOINTS.index(f"left_{name}")] for name in (far, near)]
        assert abs(float((ends[0] - ends[1]).norm()) - lengths[far]) < 0.003, far


def test_a_performance_is_taken_over() -> None:
    stance, skeleton = stance_and_skeleton()
    thetas = [performed(6), performed(7)[:25]]
    clips = [captured(theta) for theta in thetas]
    betas, motions = perform(load_free_body(), skeleton, stance, clips)
    assert np.abs(betas).max() < 0.3  # the skeleton was made of the mean body
    assert set(limb_lengths_m(skeleton, clips)) == set(BONES)
    for theta, motion in zip(thetas, motions, strict=True):
        assert motion.R_local.shape == (len(theta), 24, 3, 3)
        R = exp(torch.as_tensor(theta)).numpy()
        np.testing.assert_allclose(motion.R_local[:, 0], WORLD_FROM_BODY @ R[:, 0], atol=0.05)
        knee = SMPL_JOINTS.index("left_knee")
        bend = [log(torch.as_tensor(x[:, knee])).norm(dim=-1).numpy() for x in (motion.R_local, R)]
        np.testing.assert_allclose(*bend, atol=0.1)

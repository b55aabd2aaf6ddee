"""The packaged mixture: samples against the definition; who is in it."""

import numpy as np
import torch

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.prior import load_pose_prior


def _flexion_deg(theta: np.ndarray, joint: str, sign: float = 1.0, axis: int = 0) -> np.ndarray:
    """(N, 2) of both sides, degrees."""
    columns = [3 * (SMPL_JOINTS.index(f"{s}_{joint}") - 1) + axis for s in ("left", "right")]
    return np.asarray(sign * np.degrees(theta[:, columns]))


def test_samples_are_those_drawn_one_by_one() -> None:
    prior, count, spread = load_pose_prior(), 50, 0.7
    weight = prior.weight.numpy()
    rng = np.random.default_rng(3)
    component = rng.choice(len(weight), size=count, p=weight / weight.sum())
    noise = rng.standard_normal((count, 69))
    expected = [
        prior.mean[c].numpy() + spread * prior.cholesky[c].numpy() @ n
        for c, n in zip(component, noise, strict=True)
    ]
    sampled = prior.sample(count, np.random.default_rng(3), spread)
    np.testing.assert_allclose(sampled, expected, atol=1e-12)
    assert len(set(component)) > 2


def test_the_best_component_is_the_likeliest() -> None:
    prior = load_pose_prior()
    theta = torch.as_tensor(prior.sample(20, np.random.default_rng(1)))
    offset = theta[:, None] - prior.mean
    costs = torch.einsum("scn,cnm,scm->sc", offset, prior.precision, offset) + prior.constant
    smallest, component = prior.best(theta)
    torch.testing.assert_close(smallest, costs.min(1).values)
    assert bool((component == costs.argmin(1)).all())


def test_standing_people_stand_straight() -> None:
    prior = load_pose_prior()
    drawn = prior.sample(4000, np.random.default_rng(0))
    for poses in (prior.mean.numpy(), drawn):
        knees = _flexion_deg(poses, "knee").mean(1)
        hips = _flexion_deg(poses, "hip", -1.0).mean(1)
        standing = (knees < 30) & (hips < 15)
        assert standing.sum() >= 5
        assert np.median(knees[standing]) < 8


def test_there_is_a_component_for_what_people_do() -> None:
    mean = load_pose_prior().mean.numpy()
    knees, hips = _flexion_deg(mean, "knee"), _flexion_deg(mean, "hip", -1.0)
    elbows = np.abs(_flexion_deg(mean, "elbow", axis=1))
    straight, low = (knees < 12).all(1), (knees > 70).all(1)
    assert (straight & (hips < 15).all(1)).sum() >= 5  # standing, lying, planks
    assert (low & (hips > 70).all(1)).any()  # squats, seats
    assert (low & (hips < 40).all(1)).any()  # kneeling, bridges
    assert ((knees < 35).all(1) & (hips > 40).all(1)).any()  # folded over straight legs
    assert (np.ptp(knees, 1) > 30).any()  # kicks, lunges
    assert (straight & (elbows > 90).all(1)).any()  # hands at the head
    assert (straight & (elbows < 30).all(1)).sum() >= 2  # hanging, raised


def test_bending_straight_legs_costs_and_straightening_them_does_not() -> None:
    prior = load_pose_prior()
    standing = prior.mean[(prior.mean[:, 9] < 0.2) & (prior.mean[:, 12] < 0.2)]
    bent = standing.clone()
    bent[:, [9, 12]] += 0.6
    bent[:, [0, 3]] -= 0.3
    assert bool((prior.best(standing)[0] < prior.best(bent)[0]).all())
    assert torch.isfinite(prior.best(bent)[0]).all()

"""The packaged mixture: samples against the definition."""

import numpy as np

from imocap_core.motion.prior import load_pose_prior


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

"""Two bodies among the videos are proposed where the limbs speak for them, and only there."""

import numpy as np
import pytest

from imocap_core.diagnostics.bodies import two_bodies

A, B = np.array([0.03, -0.03, 0.02, -0.02]), np.array([-0.03, 0.04, -0.03, 0.02])


def errors(bodies, *, noise=0.005, sides=0.005, seed=0):
    """Relative limb errors (M, 4, 2) of videos of some bodies."""
    rng = np.random.default_rng(seed)
    proportions = np.array(bodies) + noise * rng.standard_normal((len(bodies), 4))
    return proportions[..., None] + sides * rng.standard_normal((len(bodies), 4, 2))


@pytest.mark.parametrize("seed", range(5))
def test_two_clear_groups(seed):
    groups = two_bodies(errors([A, B, A, B, B], seed=seed))
    assert groups is not None
    assert groups[0] == groups[2] != groups[1]
    assert groups[1] == groups[3] == groups[4]


def test_size_alone_says_nothing():
    """A camera's distance is as unknown as the person's size."""
    assert two_bodies(errors([A, A + 0.2, A + 0.2, A])) is None


@pytest.mark.parametrize(
    "unclear",
    [
        errors([A, A, A, A]),
        errors([A, B, A, B], noise=0.06, seed=1),
        errors([A, B, A, B], sides=0.08),
        errors([A, A, A, B]),  # one video may be fitted badly
        errors([A, B]),
        errors([0.3 * A, 0.3 * B, 0.3 * A, 0.3 * B]),
    ],
)
def test_what_is_unclear_is_no_proposal(unclear):
    assert two_bodies(unclear) is None


def test_limbs_that_are_seldom_across_do_not_count():
    measured = errors([A, B, A, B])
    measured[0, 3] = np.nan
    assert two_bodies(measured) is not None
    measured[1, 2] = np.nan
    assert two_bodies(measured) is None

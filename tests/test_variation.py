"""Variation over performances: known modes come back, and none is claimed of what is chance."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.biomechanics.joint_angles import mean_curve
from imocap_core.motion.multiview.modes import Modes, held_out_errors, modes, number_of_modes
from imocap_core.variation import Variation

M, N, J, FPS = 12, 60, 5, 30.0
PHASE = np.linspace(0, 2, N)
RNG = np.random.default_rng(3)


def course(seed: int, size: float) -> np.ndarray:
    """(N, J, 3) smooth, of that root mean square."""
    rng = np.random.default_rng(seed)
    made = np.sin(rng.uniform(0.5, 3, (J, 3)) * PHASE[:, None, None] + rng.uniform(0, 6, (J, 3)))
    return np.asarray(size * made / np.sqrt((made**2).mean()))


def standard(scores: np.ndarray) -> np.ndarray:
    """Mean 0 and variance 1 over the performances."""
    return np.asarray((scores - scores.mean(0)) / scores.std(0, ddof=1))


def test_a_mode_is_read_from_places_and_turns_follow_its_scores() -> None:
    scores = standard(RNG.normal(size=M))
    along = scores[:, None, None, None]
    noise = 0.2 * RNG.normal(size=(M, N, J, 3))  # radians: twists that no keypoint determines
    got = modes(along * course(1, 0.05) + noise, along * course(2, 0.02))
    assert got.share[0] > 0.999
    np.testing.assert_allclose(np.abs(got.scores[:, 0]), np.abs(scores), atol=1e-6)
    sign = np.sign(got.scores[0, 0] * scores[0])
    np.testing.assert_allclose(sign * got.shifts[0], course(2, 0.02), atol=1e-9)
    assert np.abs(sign * got.turns[0] - course(1, 0.05)).mean() < 0.06


def test_two_modes_come_apart_by_their_strength() -> None:
    first, second = np.zeros((2, N, J, 3))
    first[:, 1, 0], second[:, 2, 1] = 0.03, 0.02  # metres: a knee, an elbow
    a = np.array([3.0, -3.0, 1.0, -1.0, 0.0])
    b = np.array([1.0, 1.0, -2.0, -2.0, 2.0])  # at right angles to a, and to 1
    shifts = a[:, None, None, None] * first + b[:, None, None, None] * second
    got = modes(10 * shifts, shifts)
    assert got.of_joints()[:2].argmax(axis=1).tolist() == [1, 2]
    assert got.share[0] == pytest.approx(20 * 0.03**2 / (20 * 0.03**2 + 14 * 0.02**2))
    np.testing.assert_allclose(got.scores.sum(0), 0, atol=1e-9)
    with_scores = np.einsum("mk,knjx->mnjx", got.scores, got.shifts)
    np.testing.assert_allclose(with_scores, shifts, atol=1e-9)


@pytest.mark.parametrize("true_modes", [0, 1, 2])
def test_as_many_modes_are_known_as_predict_others(true_modes: int) -> None:
    scores = standard(RNG.normal(size=(M, 2)))
    shifts = 0.01 * RNG.normal(size=(M, N, J, 3))
    for k in range(true_modes):
        shifts += scores[:, k, None, None, None] * course(k, 0.03 / (k + 1))
    errors = held_out_errors(shifts, FPS, np.random.default_rng(0))
    assert errors[0] == 1.0
    assert number_of_modes(errors) == true_modes


def test_of_few_performances_no_mode_is_known() -> None:
    shifts = standard(RNG.normal(size=3))[:, None, None, None] * course(0, 0.03)
    assert number_of_modes(held_out_errors(shifts, FPS, np.random.default_rng(0))) == 0


def test_a_motion_at_scores_turns_along_the_modes() -> None:
    turns = course(4, 0.2)[None]
    # of a motion that stands still, with one mode
    share = np.ones(len(turns))
    given = Modes(share, np.zeros((M, len(turns))), turns, np.zeros_like(turns))
    names, ids = tuple(f"j{j}" for j in range(J)), tuple(f"v{m}" for m in range(M))
    still = np.tile(np.eye(3), (N, J, 1, 1))
    of = Variation(ids, PHASE, names, still, np.zeros((N, J, 3)), given, np.ones(1), {})
    np.testing.assert_allclose(of.at(np.zeros(1)), of.R_local)
    expected = Rotation.from_rotvec(1.5 * turns[0].reshape(-1, 3)).as_matrix()
    np.testing.assert_allclose(of.at(np.array([1.5])).reshape(-1, 3, 3), expected, atol=1e-9)
    assert np.abs(of.draw(np.random.default_rng(0)) - of.R_local).max() > 0.01
    with pytest.raises(ValueError, match="expected 1 numbers"):
        of.at(np.zeros(2))


def test_a_deviation_has_what_is_solved_and_what_is_left_open() -> None:
    """A fit that draws performances together by half says how much it leaves open."""
    true_sd, noise_sd = 6.0, 6.0
    rng, count = np.random.default_rng(1), 400
    shown = np.ones((count, 1), bool)
    detected = true_sd * rng.normal(size=(count, 1)) + noise_sd * rng.normal(size=(count, 1))
    shrink = true_sd**2 / (true_sd**2 + noise_sd**2)
    solved, left_open = shrink * detected, np.full((count, 1), np.sqrt(shrink) * noise_sd)
    alone = mean_curve(list(solved), list(shown)).sd_deg
    both = mean_curve(list(solved), list(shown), list(left_open)).sd_deg
    assert alone < 0.8 * true_sd
    assert both == pytest.approx(true_sd, rel=0.08)

"""Laws of the descent that body and hands share, on problems small enough to know."""

from dataclasses import dataclass

import numpy as np
import pytest

from imocap_core.motion.gauss_newton import LARGEST_DAMPING, descend


@dataclass
class Rosenbrock:
    """Rows of ``(1 - x)^2 + stiffness^2 (y - x^2)^2``, minimum 0 at (1, 1)."""

    stiffness: np.ndarray
    linearised: int = 0

    def residual(self, state: np.ndarray) -> np.ndarray:
        x, y = state.T
        return np.stack([1 - x, self.stiffness * (y - x**2)], -1)

    def cost(self, state: np.ndarray) -> np.ndarray:
        return (self.residual(state) ** 2).sum(-1)

    def linearise(self, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        self.linearised += 1
        J = np.zeros((len(state), 2, 2))
        J[:, 0, 0] = -1
        J[:, 1, 0], J[:, 1, 1] = -2 * self.stiffness * state[:, 0], self.stiffness
        return J.swapaxes(1, 2) @ J, (J.swapaxes(1, 2) @ self.residual(state)[..., None])[..., 0]

    def trial(self, state: np.ndarray, equations: tuple, damping: np.ndarray) -> np.ndarray:
        square, slope = equations
        lifted = square + damping[:, None, None] * square * np.eye(2)
        return state - np.linalg.solve(lifted, slope[..., None])[..., 0]

    def choose(self, better: np.ndarray, trial: np.ndarray, state: np.ndarray) -> np.ndarray:
        return np.where(better[:, None], trial, state)


STARTS = np.array([[-1.2, 1.0], [0.0, 0.0], [3.0, -2.0], [1.0, 1.0]])


def test_every_row_comes_down_to_its_minimum_and_no_cost_rises() -> None:
    problem = Rosenbrock(np.array([10.0, 1.0, 30.0, 10.0]))
    descent = descend(problem, STARTS, max_steps=200, tolerance=1e-12)
    np.testing.assert_allclose(descent.state, 1.0, atol=1e-5)
    assert descent.converged.all()
    costs = np.array(descent.costs)
    assert (np.diff(costs, axis=0) <= 0).all()
    np.testing.assert_array_equal(costs[-1], problem.cost(descent.state))
    assert problem.linearised == len(costs) - 1


def test_a_start_at_the_minimum_converges_without_moving() -> None:
    descent = descend(Rosenbrock(np.array([10.0])), STARTS[3:], max_steps=5, tolerance=1e-6)
    np.testing.assert_array_equal(descent.state, STARTS[3:])
    assert descent.converged.all()
    assert len(descent.costs) == 2


def test_a_row_that_moves_elsewhere_changes_nothing_of_a_converged_one() -> None:
    stiffness = np.array([1.0, 30.0])
    both = descend(Rosenbrock(stiffness), STARTS[[1, 2]], max_steps=200, tolerance=1e-3)
    alone = descend(Rosenbrock(stiffness[:1]), STARTS[[1]], max_steps=200, tolerance=1e-3)
    np.testing.assert_allclose(both.state[0], alone.state[0], rtol=1e-12)


def test_few_steps_leave_a_row_unconverged() -> None:
    descent = descend(Rosenbrock(np.array([30.0])), STARTS[2:3], max_steps=2, tolerance=1e-9)
    assert len(descent.costs) == 3
    assert not descent.converged.any()


def test_trials_without_a_number_are_rejected_until_the_damping_is_exhausted() -> None:
    class Broken(Rosenbrock):
        dampings: list[float]

        def trial(self, state: np.ndarray, equations: tuple, damping: np.ndarray) -> np.ndarray:
            self.dampings.append(float(damping[0]))
            return np.full_like(state, np.nan)

    problem = Broken(np.array([1.0]))
    problem.dampings = []
    descent = descend(problem, STARTS[:1], max_steps=9, tolerance=1e-9)
    np.testing.assert_array_equal(descent.state, STARTS[:1])
    assert problem.linearised == 1
    assert problem.dampings == sorted(problem.dampings)
    assert problem.dampings[-1] <= LARGEST_DAMPING < 8 * problem.dampings[-1]
    assert descent.costs[-1] == pytest.approx(descent.costs[0])

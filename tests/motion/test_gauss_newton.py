"""The solver: guaranteed descent, made truth recovered, Adam going the same way; the descent that
body and hands share."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields

import numpy as np
import pytest
import torch

from benchmarks.solver_race import adam, lbfgs
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.gauss_newton import (
    LARGEST_DAMPING,
    descend,
    gauss_newton,
    linearise,
    linearise_halves,
    objective,
)
from imocap_core.motion.monocular.fit import fit_monocular, monocular_terms
from imocap_core.motion.monocular.starts import (
    Start,
    best_path,
    lifted_starts,
    make_library,
    match,
    start_at_joints,
)
from imocap_core.motion.observations import Observation, nan_quantile, person_size_px, without_jumps
from imocap_core.motion.prior import PosePrior, load_pose_prior, mixture
from imocap_core.motion.state import FRAME_UNKNOWNS, POSE, MotionState
from imocap_core.motion.terms import PathCoupling, PoseCoupling, PosePriorTerm, Term
from imocap_core.params import InitialSmplParams
from imocap_core.rotations import exp, geodesic_angle
from imocap_core.workers import on, serial_map
from tests.motion.made import WEIGHTS, K, Made, mpjpe_mm, scene, wide_prior


@pytest.fixture(scope="module")
def made() -> Made:
    return scene(24, [0.0], np.random.default_rng(3))


def disturbed(state: MotionState, spread: float) -> MotionState:
    generator = torch.Generator().manual_seed(0)
    size = (*state.valid.shape, FRAME_UNKNOWNS)
    shift = spread * torch.randn(size, generator=generator, dtype=torch.float64)
    return state.retract(shift, torch.zeros_like(state.betas))


def terms_of(made: Made, state: MotionState, scale: float = 1.0) -> list[Term]:
    """The monocular terms of the made video, as often as there are motions."""
    seen = made.observations * len(state.trans)
    return monocular_terms(made.body, wide_prior(), seen, state.trans, WEIGHTS, scale)


def test_the_objective_never_rises(made: Made) -> None:
    terms = terms_of(made, made.state)
    solution = gauss_newton(terms, disturbed(made.state, 0.3), max_steps=8)
    assert all(b <= a for a, b in zip(solution.costs, solution.costs[1:], strict=False))
    assert solution.costs[-1] < 0.2 * solution.costs[0]


def test_a_disturbed_motion_comes_back(made: Made) -> None:
    terms = terms_of(made, made.state, scale=3.0)
    start = disturbed(made.state, 0.1)
    solution = gauss_newton(terms, start, max_steps=15)
    before, after = (mpjpe_mm(made.body, s, made.state) for s in (start, solution.state))
    assert 1.0 < after < 0.6 * before


def test_motions_of_a_batch_do_not_feel_each_other(made: Made) -> None:
    alone = disturbed(made.state, 0.1)
    both = alone.rows(torch.tensor([0, 0]))
    expected = gauss_newton(terms_of(made, alone), alone, max_steps=3).state
    found = gauss_newton(terms_of(made, both), both, max_steps=3).state
    assert torch.allclose(found.R_local[1], expected.R_local[0], atol=1e-8)


def test_a_motion_alone_is_linearised_in_halves_that_add_up(made: Made) -> None:
    terms = terms_of(made, made.state)
    state = disturbed(made.state, 0.1)
    whole = linearise(terms, state)
    in_halves = linearise_halves(terms, state, serial_map)
    with ThreadPoolExecutor(2) as pool:
        on_threads = linearise_halves(terms, state, on(pool))
    for field in fields(whole):
        expected, found, again = (getattr(x, field.name) for x in (whole, in_halves, on_threads))
        assert torch.allclose(found, expected, rtol=1e-12, atol=1e-9)
        assert torch.equal(found, again)


@pytest.mark.parametrize("motions", [1, 2])
@pytest.mark.parametrize("shared", [False, True])
def test_the_number_of_cores_changes_nothing(made, motions, shared, monkeypatch):
    start = disturbed(made.state, 0.1).rows(torch.zeros(motions, dtype=torch.long))
    terms, found = terms_of(made, start), []
    for count in (1, 2):
        monkeypatch.setattr("imocap_core.motion.gauss_newton.cores", lambda n=count: n)
        found.append(gauss_newton(terms, start, max_steps=2, shared_globals=shared))
    assert torch.equal(found[0].state.R_local, found[1].state.R_local)
    assert found[0].costs == found[1].costs


def mean_angle(a: torch.Tensor, b: torch.Tensor) -> float:
    return float(geodesic_angle(a, b).mean())


@pytest.mark.long
def test_all_solvers_reach_the_same_objective_and_lbfgs_stops_where_nothing_is_lower() -> None:
    """L-BFGS to 0.03 %, Adam, whose steps have a fixed length, to 0.5 %. Four frames in which
    nothing is left open: keypoints, and a known motion near them."""
    made = scene(4, [0.0], np.random.default_rng(3))
    trust = torch.full((1, 4, 24), 0.03**-2, dtype=torch.float64)
    known = [PoseCoupling(made.state.R_local, trust), PathCoupling(made.state.trans, trust[..., 0])]
    terms, start = [*terms_of(made, made.state, 3.0), *known], disturbed(made.state, 0.03)
    newton = gauss_newton(terms, start, max_steps=60, relative_tolerance=1e-12)
    quasi = lbfgs(terms, start, max_steps=300, relative_tolerance=1e-8)
    plain = adam(terms, start, max_steps=300, learning_rate=0.003)
    lowest = newton.costs[-1]
    assert lowest < 0.4 * newton.costs[0]
    assert quasi.costs[-1] == pytest.approx(lowest, rel=3e-4)
    assert min(plain.costs) == pytest.approx(lowest, rel=5e-3)
    for solution in (newton, quasi, plain):
        reached = float(objective(terms, solution.state).sum())
        assert reached == pytest.approx(min(solution.costs), rel=1e-9)
    found = mean_angle(newton.state.R_local, quasi.state.R_local)
    assert found < 0.1 * mean_angle(newton.state.R_local, start.R_local)
    assert "converged after" in quasi.status
    assert bool(quasi.converged.all())
    there = lbfgs(terms, newton.state, max_steps=50, relative_tolerance=1e-15)
    assert there.costs[-1] <= there.costs[0]
    assert there.costs[-1] == pytest.approx(there.costs[0], rel=3e-4)  # reweighting is linear


def test_lbfgs_never_takes_a_step_that_raises_the_objective(made: Made) -> None:
    terms = terms_of(made, made.state)
    found = lbfgs(terms, disturbed(made.state, 0.3), max_steps=12)
    assert len(found.costs) == 13
    assert all(b < a for a, b in zip(found.costs, found.costs[1:], strict=False))
    assert found.status == "L-BFGS stopped after 12 steps before it converged"
    assert not bool(found.converged.any())


def test_one_body_stays_one_body_with_every_solver(made: Made) -> None:
    both = made.state.rows(torch.tensor([0, 0]))
    start, terms = disturbed(both, 0.05), terms_of(made, both, scale=3.0)
    for solver in (gauss_newton, lbfgs, adam):
        found = solver(terms, start, max_steps=3, shared_globals=True).state
        assert torch.equal(found.betas[0], found.betas[1])
        assert not torch.equal(found.betas, start.betas)


def test_two_dimensional_keypoints_alone_lead_near_the_truth(made: Made) -> None:
    prior = load_pose_prior()
    library = make_library(made.body, prior, np.random.default_rng(0), poses=300, directions=48)
    options = InitialSmplParams(candidates=20)
    starts = [lifted_starts(made.body, library, o, options) for o in made.observations]
    assert len(starts[0]) == 2
    fit = fit_monocular(made.body, prior, made.observations, starts, WEIGHTS, stride=3, max_steps=8)
    assert len(fit.costs[0]) == 2
    assert 5.0 < mpjpe_mm(made.body, fit.state, made.state) < 150.0


def test_a_library_pose_is_found_again() -> None:
    body = scene(2, [0.0], np.random.default_rng(0)).body
    library = make_library(
        body, load_pose_prior(), np.random.default_rng(0), poses=50, directions=24
    )
    template = library.templates[24 * 7 + 5]
    xy = 300 + 100 * torch.stack([template.real, template.imag], -1)[None].expand(3, -1, -1)
    found = match(library, xy, torch.ones(3, len(template)).double(), count=5, sigma=0.05)
    path, _ = best_path(found, step_m=0.1)
    assert torch.allclose(found.R_local[0, path[0], 1:], library.R_local[7, 1:])
    assert float(found.scale_px_m[0, path[0]]) == pytest.approx(100.0, rel=1e-6)


def test_known_rotations_are_placed_where_the_body_is_seen(made: Made) -> None:
    start = start_at_joints(made.body, made.state.R_local[0], made.observations[0])
    assert isinstance(start, Start)
    assert float((start.trans - made.state.trans[0]).norm(dim=-1).max()) < 0.3


def test_a_leap_of_one_keypoint_is_not_believed() -> None:
    xy = np.tile(np.random.default_rng(0).uniform(100, 300, (1, 25, 2)), (20, 1, 1))
    xy[8, 3] += 150.0
    xy[9, 4] = np.nan
    observation = Observation(xy, np.isfinite(xy).all(-1).astype(float), K, 30.0, noise_share=0.01)
    confidence = without_jumps(observation)
    assert confidence[8, 3] == 0
    assert confidence[9, 4] == 0
    assert confidence.sum() == 20 * 25 - 2
    assert (person_size_px(observation) > 100).all()
    np.testing.assert_allclose(nan_quantile(xy, 0.96), np.nanquantile(xy, 0.96, axis=1))


BENT, HIDDEN = SMPL_JOINTS.index("left_elbow"), SMPL_JOINTS.index("left_wrist")
SPREAD_RAD, CORRELATION, MEAN_RAD = 0.3, 0.8, 0.1
ANGLE_RAD = 0.7


def prior_of_two() -> PosePrior:
    """Two joints turn about z with equal spread, correlated; all else stays near rest."""
    covariance = np.eye(69) * SPREAD_RAD**2
    a, b = (3 * (joint - 1) + 2 for joint in (BENT, HIDDEN))
    covariance[a, b] = covariance[b, a] = CORRELATION * SPREAD_RAD**2
    mean = np.zeros((1, 69))
    mean[0, [a, b]] = MEAN_RAD
    return mixture(mean, covariance[None], np.ones(1), np.ones(24), np.ones(24))


def test_a_hidden_joint_takes_its_conditional_mean_and_claims_the_conditional_spread() -> None:
    rest = torch.eye(3, dtype=torch.float64).expand(1, 1, 24, 3, 3).clone()
    target = rest.clone()
    target[0, 0, BENT] = exp(torch.tensor([0.0, 0.0, ANGLE_RAD], dtype=torch.float64))
    hold = torch.zeros(1, 1, 24, dtype=torch.float64)
    hold[..., [0, BENT]] = 1e8
    path, shape = (torch.zeros(*size, dtype=torch.float64) for size in ((1, 1, 3), (1, 10)))
    start = MotionState.of(rest, path, shape, torch.ones(1, 1, dtype=torch.bool))
    terms = [PosePriorTerm(prior_of_two(), 1.0), PoseCoupling(target, hold)]
    fitted = gauss_newton(
        terms, start, max_steps=50, relative_tolerance=1e-12, free_shape=False
    ).state
    turned = fitted.axis_angle[0, 0]
    mean = torch.tensor([0.0, 0.0, MEAN_RAD + CORRELATION * (ANGLE_RAD - MEAN_RAD)]).to(turned)
    torch.testing.assert_close(turned[HIDDEN], mean, atol=1e-4, rtol=0)
    others = [k for k in range(1, 24) if k not in (BENT, HIDDEN)]
    assert turned[others].abs().max() < 1e-4
    H = linearise(terms, fitted).diagonal[0, 0, :POSE, :POSE]
    spread = torch.linalg.inv(H)[3 * HIDDEN + 2, 3 * HIDDEN + 2].sqrt()
    conditional = SPREAD_RAD * np.sqrt(1 - CORRELATION**2)
    np.testing.assert_allclose(float(spread), conditional, rtol=1e-3)


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

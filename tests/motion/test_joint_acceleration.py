"""Laws of the accelerations of joints in space."""

import pytest
import torch

from imocap_core.body import load_free_body
from imocap_core.motion.state import Body, MotionState
from imocap_core.motion.terms import JointAcceleration

FPS = 30.0
T = 24


@pytest.fixture(scope="module")
def body() -> Body:
    return Body.of(load_free_body(), "body25")


def moving_along(path: torch.Tensor, betas: torch.Tensor | None = None) -> MotionState:
    """The rest pose along a path (T, 3)."""
    eye = torch.eye(3, dtype=torch.float64).expand(1, len(path), 24, 3, 3)
    shape = torch.zeros(1, 10, dtype=torch.float64) if betas is None else betas
    return MotionState.of(eye, path[None], shape, torch.ones(1, len(path), dtype=torch.bool))


def path_of(accelerations: torch.Tensor) -> torch.Tensor:
    """(T, 3) metres, along x, with the given second differences."""
    x = torch.zeros(T, 3, dtype=torch.float64)
    x[2:, 0] = accelerations.cumsum(0).cumsum(0)
    return x


def test_uniform_motion_costs_nothing(body: Body) -> None:
    steps = torch.arange(T, dtype=torch.float64)[:, None] * torch.tensor([0.1, 0.0, 0.2])
    assert JointAcceleration(body, FPS, 1.0).cost(moving_along(steps)).item() < 1e-12


def test_one_spell_costs_less_than_restlessness(body: Body) -> None:
    """The same squared acceleration, once in three frames and once in all."""
    spell, restless = torch.zeros(T - 2).double(), torch.ones(T - 2).double()
    spell[9:12] = ((T - 2) / 3) ** 0.5
    term = JointAcceleration(body, FPS, 1.0)
    costs = [term.cost(moving_along(path_of(0.02 * a))).item() for a in (spell, restless)]
    assert costs[0] < 0.6 * costs[1]


def test_a_larger_body_that_accelerates_as_much_more_costs_the_same(body: Body) -> None:
    betas = torch.zeros(1, 10, dtype=torch.float64)
    betas[0, 0] = 1.5
    rest = [body.model.shape(b).joints_rest[:, 1] for b in (torch.zeros(10).double(), betas[0])]
    head, ankle = (body.joints.names.index(name) for name in ("head", "left_ankle"))
    factor = (rest[1][head] - rest[1][ankle]) / (rest[0][head] - rest[0][ankle])
    path = path_of(0.004 * torch.sin(torch.arange(T - 2, dtype=torch.float64)))
    term = JointAcceleration(body, FPS, 1.0)
    mean, large = term.cost(moving_along(path)), term.cost(moving_along(factor * path, betas))
    assert abs(factor.item() - 1) > 0.01
    torch.testing.assert_close(mean, large, rtol=1e-3, atol=0.0)


def test_frame_rate_changes_only_the_number_of_frames(body: Body) -> None:
    """A constant acceleration, filmed at two rates."""

    def cost(fps: float) -> float:
        time = torch.arange(8 * int(fps), dtype=torch.float64) / fps
        path = torch.zeros(len(time), 3, dtype=torch.float64)
        path[:, 0] = 0.5 * time**2
        return JointAcceleration(body, fps, 1.0).cost(moving_along(path)).item() / len(time)

    assert cost(60.0) == pytest.approx(cost(30.0), rel=0.02)

"""Everything is computed where the state is: on CUDA where there is one, and by rule where not."""

from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode
from torch.utils._pytree import tree_leaves

from benchmarks.solver_race import adam, lbfgs, made_scene
from imocap_core.motion.gauss_newton import gauss_newton, linearise, linearise_halves, objective
from imocap_core.motion.monocular.fit import monocular_terms
from imocap_core.motion.multiview.smpl_ba import solve_jointly
from imocap_core.motion.normal import solve_globals
from imocap_core.motion.terms import Term
from imocap_core.params import FitParams, MotionParams
from imocap_core.workers import serial_map
from tests.motion.made import WEIGHTS, Made, scene, wide_prior
from tests.motion.test_gauss_newton import disturbed
from tests.motion.test_terms import TERMS, state, with_rigid_offsets

__all__ = ["state"]  # a fixture

MAKERS = [
    torch.tensor, torch.as_tensor, torch.from_numpy, torch.zeros, torch.ones, torch.eye,
    torch.empty, torch.full, torch.arange, torch.linspace, torch.rand, torch.randn,
]  # fmt: skip


class Homeless(TorchFunctionMode):
    """Notes what is computed with tensors that were made without saying on which device.

    On a CPU they do no harm; on another device they would not meet the state's. Moving them
    (`to`) gives them a home; a single number may meet tensors of any device.
    """

    def __init__(self) -> None:
        super().__init__()
        self.made: dict[int, Tensor] = {}
        self.met: list[str] = []

    def __torch_function__(
        self, func: Callable[..., Any], types: Any, args: Any = (), kwargs: Any = None
    ) -> Any:
        kwargs = kwargs or {}
        given = [x for x in tree_leaves((args, kwargs)) if isinstance(x, Tensor)]
        homeless = any(id(x) in self.made for x in given)
        result = func(*args, **kwargs)
        if homeless and func is Tensor.to:
            return result.clone()  # on a CPU it may be the same tensor
        if homeless:
            self.met.append(func.__name__)
        made_here = func in MAKERS and kwargs.get("device") is None and not given
        if made_here and result.ndim > 0:
            self.made[id(result)] = result
        return result


@pytest.fixture(scope="module")
def made() -> Made:
    return scene(6, [0.0], np.random.default_rng(3))


def test_a_homeless_tensor_is_noticed() -> None:
    x = torch.ones(3, 3)
    with Homeless() as watch:
        _ = x @ torch.eye(3, device=x.device) + torch.zeros(3).to(x) + torch.tensor(1.0)
        assert watch.met == []
        _ = x @ torch.eye(3)
    assert watch.met == ["matmul"]


@pytest.mark.parametrize("name", [*TERMS, "with_rigid_offsets"])
def test_terms_make_their_tensors_where_the_state_is(body, state, name):
    term = {**TERMS, "with_rigid_offsets": with_rigid_offsets}[name](body, state)
    with Homeless() as watch:
        term.cost(state)
        linearise([term], state)
    assert watch.met == []


def test_the_solver_makes_its_tensors_where_the_state_is(made: Made) -> None:
    terms = all_terms(made)
    with Homeless() as watch:
        system = linearise_halves(terms, made.state, serial_map)
        reduced = system.reduce(1e-3)
        d_globals = solve_globals([reduced], 1e-3)
        moved = made.state.retract(reduced.frames(d_globals[None]), d_globals[None])
        objective(terms, moved)
        adam(terms, made.state, max_steps=1)
    assert watch.met == []


@pytest.mark.skipif(not torch.cuda.is_available(), reason="this machine has no CUDA device")
@pytest.mark.parametrize("solver", [gauss_newton, lbfgs, adam])
def test_a_cuda_device_finds_the_same_motion(made: Made, solver: Callable[..., Any]) -> None:
    terms, start = all_terms(made), disturbed(made.state, 0.05)
    here = solver(terms, start, max_steps=5)
    there = solver(on_cuda(terms), on_cuda(start), max_steps=5)
    assert there.state.R_local.is_cuda
    assert there.costs == pytest.approx(here.costs, rel=1e-6)
    assert torch.allclose(there.state.R_local.cpu(), here.state.R_local, atol=1e-5)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="this machine has no CUDA device")
def test_all_of_smpl_ba_runs_on_a_cuda_device() -> None:
    made = made_scene(2, 30, FitParams(), 3)
    here = solve_jointly(made.scene, made.start, MotionParams())
    there = solve_jointly(on_cuda(made.scene), on_cuda(made.start), MotionParams())
    assert there.state.R_local.is_cuda
    assert torch.allclose(there.state.trans.cpu(), here.state.trans, atol=1e-6)
    assert torch.allclose(there.state.R_local.cpu(), here.state.R_local, atol=1e-6)


def all_terms(made: Made) -> list[Term]:
    return monocular_terms(
        made.body, wide_prior(), made.observations, made.state.trans, WEIGHTS, 1.0
    )


def on_cuda(value: Any) -> Any:
    """A value with all tensors inside it on the first CUDA device."""
    if isinstance(value, Tensor):
        return value.to("cuda")
    if isinstance(value, (list, tuple)):
        return type(value)(on_cuda(x) for x in value)
    if is_dataclass(value) and not isinstance(value, type):
        kept = {f.name: on_cuda(getattr(value, f.name)) for f in fields(value) if f.init}
        return replace(value, **kept)
    return value

"""Speed of the body model, beside automatic differentiation of the same function."""

from __future__ import annotations

import ctypes
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from imocap_core.body import Model, PointSet, keypoints_with_jacobian, load_free_body
from imocap_core.rotations import exp

LAYOUT = "body25"
REPEATS = 40


@dataclass(frozen=True)
class BodySpeedRow:
    """One measurement: the best of several runs, and the peak of memory it added."""

    what: str
    dtype: str
    milliseconds: float
    megabytes: float  # NaN where the system has no figure
    note: str = ""


def measure(
    threads: int = 2, bodies: int = 800, meshes: int = 200, seconds: float = 1.5, seed: int = 0
) -> list[BodySpeedRow]:
    """All rows, in float32 and float64, on `threads` threads; about `seconds` for each row."""
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        return [
            row
            for dtype in (torch.float32, torch.float64)
            for row in _rows(dtype, bodies, meshes, seconds, seed)
        ]
    finally:
        torch.set_num_threads(before)


def _rows(
    dtype: torch.dtype, bodies: int, meshes: int, seconds: float, seed: int
) -> list[BodySpeedRow]:
    rng = np.random.default_rng(seed)

    def normal(*shape: int) -> Tensor:
        return torch.as_tensor(rng.normal(size=shape), dtype=dtype)

    model = load_free_body(dtype=dtype)
    points = model.points(LAYOUT)
    theta, transl, betas = 0.4 * normal(bodies, 24, 3), normal(bodies, 3), normal(10)
    R_local = exp(theta)
    own_betas = normal(bodies, 10)
    name = str(dtype).removeprefix("torch.")

    def row(what: str, work: Callable[[], object], note: str = "") -> BodySpeedRow:
        milliseconds, megabytes = _best(work, seconds)
        return BodySpeedRow(what, name, milliseconds, megabytes, note)

    automatic = automatic_jacobian(model, points)
    jacobian = row(
        f"{bodies} bodies x {len(points.names)} keypoints, full Jacobian",
        lambda: keypoints_with_jacobian(model.shape(betas), points, R_local, transl),
        note="72 pose and 10 shape columns; by translation it is the identity",
    )
    forward = row("the same by torch.func.jacfwd", lambda: automatic(theta, betas, transl))
    ratio = forward.milliseconds / jacobian.milliseconds
    return [
        jacobian,
        BodySpeedRow(
            forward.what, name, forward.milliseconds, forward.megabytes, f"{ratio:.0f} x slower"
        ),
        row(
            "the same, every body its own shape",
            lambda: keypoints_with_jacobian(model.shape(own_betas), points, R_local, transl),
        ),
        row(
            f"{bodies} bodies, joints only", lambda: model.shape(betas).pose(R_local, transl).joints
        ),
        row(
            f"{bodies} bodies, {len(points.names)} keypoints",
            lambda: model.shape(betas).pose(R_local, transl).keypoints(points),
        ),
        row(
            f"{meshes} bodies, full mesh",
            lambda: model.shape(betas).pose(R_local[:meshes], transl[:meshes]).mesh(),
            note=f"{len(model.v_template)} vertices each",
        ),
    ]


def automatic_jacobian(
    model: Model, points: PointSet
) -> Callable[[Tensor, Tensor, Tensor], object]:
    """Forward-mode Jacobian of each body's keypoints by its pose, shape and translation."""

    def place(theta: Tensor, betas: Tensor, transl: Tensor) -> Tensor:
        return model.shape(betas).pose(exp(theta), transl).keypoints(points)

    jacobian = torch.func.jacfwd(place, argnums=(0, 1, 2))
    return torch.func.vmap(jacobian, in_dims=(0, None, 0))


def _best(work: Callable[[], object], seconds: float) -> tuple[float, float]:
    """Shortest wall time in milliseconds after a warm-up, and the peak of memory it added, MB."""
    best = float("inf")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # torch.func warns of its own internals
        peak = _peak_megabytes(work)
        spent, repeats = 0.0, 0
        while spent < seconds and repeats < REPEATS:
            start = time.perf_counter()
            work()
            took = time.perf_counter() - start
            best, spent, repeats = min(best, took), spent + took, repeats + 1
    return 1e3 * best, peak


def _peak_megabytes(work: Callable[[], object]) -> float:
    """Growth of this process' peak resident memory while `work` runs (Linux, glibc), else NaN."""
    status, reset = Path("/proc/self/status"), Path("/proc/self/clear_refs")
    try:
        work()
        ctypes.CDLL(None).malloc_trim(0)  # give freed memory back, or reusing it would cost nothing
        reset.write_text("5", encoding="ascii")  # the peak starts again at what is in use now
        before = _kilobytes(status, "VmHWM")
        work()
        return (_kilobytes(status, "VmHWM") - before) / 1e3
    except (OSError, AttributeError):
        return float("nan")


def _kilobytes(status: Path, field: str) -> float:
    lines = status.read_text(encoding="ascii").splitlines()
    return float(next(line for line in lines if line.startswith(field)).split()[1])

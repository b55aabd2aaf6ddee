"""Compile the loops of a run and keep them, so that the first run does not wait for it.

    python -m tools.compile_loops

Each is called as a run calls it, on a few frames: a loop is compiled for the types it is given. One
that is missing here is named, and compiled by the first run.
"""

from __future__ import annotations

import sys

import numpy as np
import torch
from numba.core.dispatcher import Dispatcher

from imocap_core.body.free import load_free_body
from imocap_core.metrics.whole_body import edges_of, stretched_edge_shares
from imocap_core.motion.gauss_newton import gauss_newton
from imocap_core.motion.monocular.fit import regularisers
from imocap_core.motion.prior import load_pose_prior
from imocap_core.motion.state import Body, MotionState
from imocap_core.motion.terms import Reprojection, View
from imocap_core.params import FitParams
from imocap_core.render import draw_mesh
from imocap_core.sync.maps import whole_band
from imocap_core.sync.screening.registration import warp_costs
from imocap_core.sync.warp.dtw import dtw
from imocap_core.sync.warp.monotone import banded_posterior
from imocap_core.sync.warp.rate import heavy_tailed_prior, rate_posterior

FRAMES = 4
K = np.array([[500.0, 0.0, 320.0], [0.0, 500.0, 180.0], [0.0, 0.0, 1.0]])


def compile_fit(body: Body) -> None:
    """The loops of a fit, by one step of one."""
    eye, ones = torch.eye(3).double(), torch.ones(1, FRAMES, 1).double()
    trans = ones * torch.tensor([0.0, 0.0, 4.0])
    start = MotionState.of(
        eye.expand(1, FRAMES, 24, 3, 3).clone(), trans, ones.new_zeros(1, 10), ones[..., 0] > 0
    )
    count = len(body.keypoints.names)
    view = View(
        xy_px=200.0 * ones[..., None].expand(-1, -1, count, 2),
        weight=0.1 * ones.expand(-1, -1, count),
        K=torch.as_tensor(K)[None],
        R=eye[None],
        t=ones.new_zeros(1, 3),
        offset_precision=100.0 * ones.expand(-1, -1, 6),
    )
    terms = regularisers(body, load_pose_prior(), FitParams(), 30.0)
    gauss_newton([Reprojection(body, (view,), 3.0), *terms], start, max_steps=1)


def missing_loops() -> list[str]:
    """Loops of the core that no call has compiled; those that others call come with these."""
    modules = [vars(module) for name, module in sys.modules.items() if name.startswith("imocap_")]
    loops = {x for names in modules for x in names.values() if isinstance(x, Dispatcher)}
    called = {name for loop in loops for name in loop.py_func.__code__.co_names}
    names = [loop.__name__ for loop in loops if not loop.signatures]
    return sorted({*names} - called)


def main() -> int:
    """All of them; 1: one is missing here."""
    body = Body.of(load_free_body(dtype=torch.float64), "body25")
    compile_fit(body)
    banded_posterior(whole_band(np.ones((FRAMES, FRAMES))), unmatched=np.inf)
    rate_posterior(np.ones((FRAMES, FRAMES)), heavy_tailed_prior(1.0, 0.1), unmatched=1.0)
    warp_costs(np.ones((1, FRAMES, FRAMES)))
    dtw(np.ones((FRAMES, FRAMES)))
    shaped = body.model.shape(torch.zeros(10).double())
    pose = torch.eye(3).double().expand(FRAMES, 24, 3, 3), torch.zeros(FRAMES, 3).double()
    vertices, faces = shaped.pose(*pose).mesh().vertices.numpy(), body.model.faces.numpy()
    stretched_edge_shares(vertices, shaped.vertices_rest.numpy(), edges_of(faces))
    picture, far = np.zeros((360, 640, 3), np.uint8), np.array([0.0, 0.0, 4.0])
    draw_mesh(picture, vertices[0], faces.astype(np.int64), np.ones(3), K, np.eye(3), far)
    if missing := missing_loops():
        print(f"imocap: the first run compiles {', '.join(missing)}: add them to {__file__}")
    return 1 if missing else 0


if __name__ == "__main__":
    raise SystemExit(main())

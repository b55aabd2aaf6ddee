"""How far performances stray from each other as wholes: six variances a video, from the images.

Expectation maximisation on the strays of `terms.stray`: given the spread, every frame's stray has
a posterior; given the posteriors, the spread is their mean square. Depth, which one view hardly
sees, keeps its prior and does not vote against what the image plane shows, because a posterior
counts with its own uncertainty.
"""

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from imocap_core.motion.kinematics import Body
from imocap_core.motion.multiview.consensus import Cameras
from imocap_core.motion.multiview.shared import Evidence, views_of
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms import Reprojection, View
from imocap_core.params import MotionParams
from imocap_core.workers import at_once, in_turn

Array = NDArray[np.float64]
ROUNDS = 6


def first_strays(videos: int, options: MotionParams) -> Array:
    """(M, 6) generous spreads to begin with."""
    turn, shift = options.rigid_offset_start_rad, options.rigid_offset_start_m
    return np.tile([turn] * 3 + [shift] * 3, (videos, 1))


def estimate_strays(
    body: Body,
    shared: MotionState,
    evidence: Evidence,
    cameras: Cameras,
    options: MotionParams,
    *,
    robust_scale: float,
) -> Evidence:
    """The evidence with spreads that its own images tell (videos that show nothing keep theirs)."""
    if evidence.stray is None:
        return evidence
    views = views_of(evidence, cameras, shared.trans, free=())
    term = Reprojection(body, views, robust_scale)
    known = list(zip(views, evidence.stray, strict=True))
    each = in_turn if shared.trans.is_cuda else at_once
    spread = each(lambda own: _spread(term, own[0], shared, own[1], options), known)
    return replace(evidence, stray=np.stack(spread))


def _spread(
    term: Reprojection, view: View, shared: MotionState, before: Array, options: MotionParams
) -> Array:
    seen = (view.weight > 0).sum(-1)[0] >= 4
    if not bool(seen.any()):
        return before
    sigma, d = torch.as_tensor(before).to(shared.trans), None
    for _ in range(ROUNDS):
        precision = sigma.pow(-2).expand(1, len(seen), -1)
        d, sharpness = term.strays(view, shared, precision, d)
        sigma = _mean_square(d[0, seen], torch.linalg.inv(sharpness[0, seen]), options).sqrt()
    found: Array = sigma.cpu().numpy()
    return found


def _mean_square(d: Tensor, covariance: Tensor, options: MotionParams) -> Tensor:
    """(6,) one variance of the three turns and one of the three shifts."""
    square = d.square() + covariance.diagonal(dim1=-2, dim2=-1)
    turn = square[:, :3].mean().clamp_min(options.rigid_offset_floor_rad**2)
    shift = square[:, 3:].mean().clamp_min(options.rigid_offset_floor_m**2)
    return torch.cat([turn.expand(3), shift.expand(3)])

"""Where the wrist may point: many starts in single frames, and the smoothest cheap path of them.

A body's keypoints say little about how a forearm is twisted, so the hand may begin half a turn
away from its keypoints, where no small step leads. Every few frames the fit is tried from a set of
turns, each frame by itself; the path with the lowest sum of objectives and turning speeds starts
the fit over time.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from imocap_core.hands.problem import HandState
from imocap_core.hands.solver import HandProblem, solve_hands
from imocap_core.motion.timeline import sample, sample_rotations
from imocap_core.rotations import exp, geodesic_angle

_TWISTS_DEG, _BENDS_DEG = (-120, -60, 0, 60, 120, 180), (-45, 45)
_SPEED_RAD_S = 3.0  # a turn of a wrist at this speed costs 1
_STEPS = 8


def wrist_starts() -> Tensor:
    """(H, 3, 3) turns of a hand against the body's: about the forearm, then at the wrist."""
    turns = [(t, b) for t in _TWISTS_DEG for b in _BENDS_DEG]
    radians = torch.deg2rad(torch.tensor(turns, dtype=torch.float64))
    zero = torch.zeros_like(radians[:, 0])
    twist = torch.stack([radians[:, 0], zero, zero], -1)  # forearms lie along x at rest
    bend = torch.stack([zero, zero, radians[:, 1]], -1)
    return exp(twist) @ exp(bend)


def started(problem: HandProblem, stride_s: float) -> HandState:
    """A state near the keypoints for all frames of a problem."""
    views, frames = problem.views, problem.views.valid.shape[1]
    stride = max(1, round(stride_s * float(problem.fps.min())))
    chosen = np.unique(np.append(np.arange(0, frames, stride), frames - 1))
    few = views.frames(torch.as_tensor(chosen))
    turns = wrist_starts()
    alone = few.single_frames(len(turns))
    batch, count = few.valid.shape
    start = HandState(
        R_wrist=alone.R_body @ turns.repeat(batch * count, 1, 1)[:, None],
        angles=alone.R_body.new_zeros(len(alone.valid), 1, 21),
        offset_m=torch.zeros_like(alone.wrist_m),
    )
    fps = problem.fps.new_ones(len(alone.valid))
    frame_problem = replace(problem, views=alone, fps=fps, common=None)
    state, cost = solve_hands(frame_problem, start, _STEPS)
    shape = (batch, count, len(turns))
    paths = []
    for b in range(batch):
        R = state.R_wrist.reshape(*shape, 3, 3)[b]
        seconds = np.diff(chosen) / float(problem.fps[b])
        best = cheapest_path(cost.reshape(shape)[b], R, seconds)
        pick = torch.arange(count), best
        at = np.interp(np.arange(frames), chosen, np.arange(count))
        paths.append(
            HandState(
                sample_rotations(R[pick][:, None], at)[:, 0],
                sample(state.angles.reshape(*shape, -1)[b][pick], at),
                sample(state.offset_m.reshape(*shape, -1, 3)[b][pick], at),
            )
        )
    return HandState(
        R_wrist=torch.stack([p.R_wrist for p in paths]),
        angles=torch.stack([p.angles for p in paths]),
        offset_m=torch.stack([p.offset_m for p in paths]),
    )


def cheapest_path(cost: Tensor, R: Tensor, seconds: np.ndarray) -> Tensor:
    """(N,) which of H candidates in each frame: the lowest sum of costs (N, H) and of squared
    turning speeds between candidates R (N, H, 3, 3) that lie `seconds` (N - 1,) apart."""
    total, back = cost[0], list[Tensor]()
    for n in range(1, len(cost)):
        angle = geodesic_angle(R[n - 1][:, None], R[n][None])
        ways = total[:, None] + (angle / (_SPEED_RAD_S * float(seconds[n - 1]))) ** 2
        least, origin = ways.min(0)
        total, back = cost[n] + least, [*back, origin]
    path = [int(total.argmin())]
    for origin in reversed(back):
        path.append(int(origin[path[-1]]))
    return torch.tensor(path[::-1])

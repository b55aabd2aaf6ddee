"""Initial wrist rotations: many starts in single frames, and the cheapest smooth path of them.

A body's keypoints hardly determine how a forearm is twisted, so the hand may begin half a turn
away from its keypoints, where no small step leads. Every few frames the fit is tried from a set of
rotations, each frame by itself; the path with the lowest sum of objectives and rotation speeds is
the initial state of the fit over time.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from imocap_core.hands.solver import HandProblem, solve_hands
from imocap_core.hands.state import HandState
from imocap_core.motion.multiview.timeline import sample, sample_rotations
from imocap_core.rotations import exp, geodesic_angle

_TWISTS_DEG, _BENDS_DEG = (-120, -60, 0, 60, 120, 180), (-45, 45)
_SPEED_RAD_S = 3.0  # rotation speed of a wrist that costs 1
_STEPS = 8
_AT_ONCE = 16  # frames: bounds the memory of long videos


def wrist_starts() -> Float[Tensor, "H 3 3"]:
    """Rotations of a hand against the body's: about the forearm, then at the wrist."""
    angles = [(t, b) for t in _TWISTS_DEG for b in _BENDS_DEG]
    radians = torch.deg2rad(torch.tensor(angles, dtype=torch.float64))
    zero = torch.zeros_like(radians[:, 0])
    twist = torch.stack([radians[:, 0], zero, zero], -1)  # forearms lie along x at rest
    bend = torch.stack([zero, zero, radians[:, 1]], -1)
    return exp(twist) @ exp(bend)


def initial_state(problem: HandProblem, stride_s: float) -> HandState:
    """A state near the keypoints for all frames of a problem."""
    frames = problem.views.valid.shape[1]
    stride = max(1, round(stride_s * float(problem.fps.min())))
    chosen = np.unique(np.append(np.arange(0, frames, stride), frames - 1))
    parts = [
        _tried(problem, torch.as_tensor(chosen[k : k + _AT_ONCE], device=problem.fps.device))
        for k in range(0, len(chosen), _AT_ONCE)
    ]
    all_R, all_angles, all_offsets, cost = (
        torch.cat(each, dim=1) for each in zip(*parts, strict=True)
    )
    count = len(chosen)
    paths: list[tuple[Tensor, Tensor, Tensor]] = []
    for b, R in enumerate(all_R):
        seconds = np.diff(chosen) / float(problem.fps[b])
        best = cheapest_path(cost[b], R, seconds)
        pick = torch.arange(count, device=best.device), best
        position = np.interp(np.arange(frames), chosen, np.arange(count))
        paths.append(
            (
                sample_rotations(R[pick][:, None], position)[:, 0],
                sample(all_angles[b][pick], position),
                sample(all_offsets[b][pick], position),
            )
        )
    R_wrist, angles, offset_m = (torch.stack(part) for part in zip(*paths, strict=True))
    return HandState(R_wrist, angles, offset_m)


def _tried(problem: HandProblem, frames: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Every rotation in each of N frames by itself: R_wrist (B, N, H, 3, 3), angles (B, N, H, 21),
    offsets (B, N, H, V, 3) and objectives (B, N, H)."""
    few = problem.views.frames(frames)
    rotations = wrist_starts().to(problem.fps)
    alone = few.single_frames(len(rotations))
    shape = (*few.valid.shape, len(rotations))
    start = HandState(
        R_wrist=alone.R_body @ rotations.repeat(few.valid.numel(), 1, 1)[:, None],
        angles=alone.R_body.new_zeros(len(alone.valid), 1, 21),
        offset_m=torch.zeros_like(alone.wrist_m),
    )
    fps = problem.fps.new_ones(len(alone.valid))
    each = replace(problem, views=alone, fps=fps, common=None)
    state, cost = solve_hands(each, start, _STEPS)
    return (
        state.R_wrist.reshape(*shape, 3, 3),
        state.angles.reshape(*shape, -1),
        state.offset_m.reshape(*shape, -1, 3),
        cost.reshape(shape),
    )


def cheapest_path(
    cost: Float[Tensor, "N H"], R: Float[Tensor, "N H 3 3"], seconds: Float[np.ndarray, " _"]
) -> Int[Tensor, " N"]:
    """Candidate of each frame, by the lowest sum of costs and of squared rotation speeds.

    Args:
        cost: of H candidates a frame; R: their rotations; seconds: (N - 1,) between frames.
    """
    total, back = cost[0], list[Tensor]()
    for n in range(1, len(cost)):
        angle = geodesic_angle(R[n - 1][:, None], R[n][None])
        ways = total[:, None] + (angle / (_SPEED_RAD_S * float(seconds[n - 1]))) ** 2
        least, origin = ways.min(0)
        total, back = cost[n] + least, [*back, origin]
    path = [int(total.argmin())]
    for origin in reversed(back):
        path.append(int(origin[path[-1]]))
    return torch.tensor(path[::-1], device=cost.device)

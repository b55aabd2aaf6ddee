"""Windows of motion for the lifter's training: captured, made, recombined, drawn from the prior.

All windows are drawn with one generator and applied to bodies of random shapes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from imocap_core.body import PointSet, join_points, load_free_body, pick_points
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.lifter.lifter_network import WINDOW
from imocap_core.motion.prior import load_pose_prior
from imocap_core.motion.terms.body_priors import HINGES
from imocap_core.rotations import exp, log
from lifter.motions import FittedClip, mirrored_clip

STEPS = (1, 2, 2, 2, 3)  # frames of 1/30 s between those of a window: slow, original, fast
MADE, RECOMBINED, DRAWN = 0.65, 0.2, 0.05  # shares of windows; the others are captured
ARMS = [k for k, n in enumerate(SMPL_JOINTS)
        if any(p in n for p in ("collar", "shoulder", "elbow", "wrist", "hand"))]  # fmt: skip
PRIOR_POOL, PRIOR_SPREAD = 20000, 1.15
TUMBLED = 0.12  # share of windows that lie, hang or stand on their heads
LEAN_RAD = 0.12
SHAPE_SPREAD = 1.2


@dataclass(frozen=True)
class Motions:
    """All frames of all clips in a row: R_local (N, 24, 3, 3), trans (N, 3), and the frames at
    which a window of each step may begin, in captured and in made motions."""

    R_local: Tensor
    trans: Tensor
    begins: dict[int, tuple[np.ndarray, np.ndarray]]
    prior: Tensor  # (PRIOR_POOL, 69) poses within joint limits


def motions_of(
    captured: list[FittedClip], made: list[FittedClip], rng: np.random.Generator
) -> Motions:
    """The captured clips and their mirror images, and the made ones."""
    clips = [c for clip in captured for c in (clip, mirrored_clip(clip))] + made
    begins: dict[int, tuple[list[np.ndarray], ...]] = {step: ([], []) for step in set(STEPS)}
    start = 0
    for row, (theta, _) in enumerate(clips):
        for step, starts in begins.items():
            first = start + np.arange(max(0, len(theta) - step * (WINDOW - 1)))
            starts[row >= 2 * len(captured)].append(first)
        start += len(theta)
    theta = torch.as_tensor(np.concatenate([t for t, _ in clips]), dtype=torch.float32)
    trans = torch.as_tensor(np.concatenate([p for _, p in clips]), dtype=torch.float32)
    poses = torch.as_tensor(load_pose_prior().sample(PRIOR_POOL, rng, PRIOR_SPREAD)).float()
    rows = {s: (np.concatenate(a), np.concatenate(b)) for s, (a, b) in begins.items()}
    return Motions(exp(theta), trans, rows, _within_limits(poses))


def windows(motions: Motions, count: int, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
    """R_local (B, L, 24, 3, 3), z up, and root paths (B, L, 3)."""
    kind = rng.random(count)
    R, trans = _shown(motions, count, rng)
    mixed = np.flatnonzero(kind < RECOMBINED)
    other, _ = _shown(motions, len(mixed), rng)
    R[mixed[:, None, None], np.arange(WINDOW)[None, :, None], np.array(ARMS)[None, None]] = other[
        :, :, ARMS
    ]
    drawn = np.flatnonzero(kind > 1 - DRAWN)
    R[drawn, :, 1:] = _from_prior(motions, len(drawn), rng)
    tumbled = np.flatnonzero(rng.random(count) < TUMBLED)
    axis = rng.normal(size=(count, 3)) * LEAN_RAD * (1, 1, 0)
    axis[tumbled] = rng.normal(size=(len(tumbled), 3)) * 1.2
    turn = exp(torch.as_tensor(axis, dtype=torch.float32))
    R[:, :, 0] = turn[:, None] @ R[:, :, 0]
    middle = trans.mean(1, keepdim=True)
    return R, torch.einsum("bij,blj->bli", turn, trans - middle)


def _shown(motions: Motions, count: int, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
    step, made = rng.choice(STEPS, count), rng.random(count) < MADE
    rows = [motions.begins[s][int(m)] for s, m in zip(step, made, strict=True)]
    first = np.array([r[rng.integers(len(r))] for r in rows], int)
    rows = first[:, None] + step[:, None] * np.arange(WINDOW)
    back = rng.random(count) < 0.1  # films run backwards are motions too
    rows[back] = rows[back][:, ::-1]
    frames = torch.as_tensor(rows)
    return motions.R_local[frames].clone(), motions.trans[frames].clone()


def _from_prior(motions: Motions, count: int, rng: np.random.Generator) -> Tensor:
    """(B, L, 23, 3, 3): interpolation between random poses, at a random pace for each window."""
    keys = 6
    poses = motions.prior[torch.as_tensor(rng.integers(len(motions.prior), size=(count, keys)))]
    pace = rng.uniform(0.04, 0.16, (count, 1))
    position = np.clip(pace * np.arange(WINDOW) + rng.random((count, 1)), 0, keys - 1.001)
    low = torch.as_tensor(position.astype(int))
    share = torch.as_tensor(position % 1.0, dtype=torch.float32)
    share = (share * share * (3 - 2 * share))[..., None]
    rows = torch.arange(count)[:, None]
    theta = poses[rows, low] * (1 - share) + poses[rows, low + 1] * share
    return exp(theta.unflatten(-1, (23, 3)))


def _within_limits(poses: Tensor) -> Tensor:
    """Poses whose knees and elbows do not bend backwards."""
    limited = poses.clone()
    for name, axis, sign in HINGES:
        column = 3 * (SMPL_JOINTS.index(name) - 1) + axis
        limited[:, column] = sign * (sign * limited[:, column]).clamp_min(-0.05)
    return log(exp(limited.unflatten(-1, (23, 3)))).flatten(1)


class TrainingBodies:
    """The free body with the lifter's points and SMPL's joints."""

    def __init__(self) -> None:
        self.model = load_free_body(dtype=torch.float32)
        self.points = _common_points(self.model)
        self.joints = self.model.points("smpl24")

    def perform(
        self, R_local: Tensor, trans: Tensor, rng: np.random.Generator
    ) -> tuple[Tensor, Tensor]:
        """Points (B, L, K, 3) and joints (B, L, 24, 3) of bodies of random shape."""
        betas = rng.normal(size=(len(R_local), 1, 10)) * SHAPE_SPREAD
        shaped = self.model.shape(torch.as_tensor(betas, dtype=torch.float32))
        posed = shaped.pose(R_local, trans)
        return posed.keypoints(self.points), posed.keypoints(self.joints)


def _common_points(model) -> PointSet:
    """`imocap_core.lifter.lifter_network.COMMON` on the body, in that order."""
    feet = [f"{s}_{p}" for p in ("big_toe", "small_toe", "heel") for s in ("left", "right")]
    sets = [
        model.points("coco17"),
        pick_points(model.points("body25b"), feet),
        pick_points(model.points("halpe26"), ["neck", "mid_hip", "head_top"]),
        pick_points(model.points("body25b"), ["upper_neck"]),
        pick_points(
            model.points("smpl24"), ["left_hip", "right_hip", "pelvis", "spine2", "neck", "head"]
        ),
    ]
    return join_points(sets)

"""An action's result on the time axis that all its videos share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from imocap_core.camera.world import BodyMotion
from imocap_core.errors import WorkFailed
from imocap_core.export.clips import body_of
from imocap_core.export.values import HandTrack, Performance, Result
from imocap_core.motion.multiview.common_time import (
    Moments,
    common_grid,
    moments_of,
    pose_at,
    values_at,
)


def on_common_time(result: Result) -> Result:
    """Every video at the moments of one grid, in steps of the reference's frames.

    Where a video shows nothing of a moment it holds its nearest end (`inside` is False there).
    Videos without a place on the axis are left out. WorkFailed when none has one.
    """
    placed = [p for p in result.performances if np.isfinite(p.phase_s).any()]
    if not placed:
        raise WorkFailed(
            f"{result.action} has no common time axis: its sync artifact holds no phases. Leave "
            f"--time out for the videos' own timelines"
        )
    rate = next(p.fps for p in result.performances if p.id == result.reference)
    grid_s = common_grid([p.phase_s for p in placed], rate)
    return replace(
        result,
        performances=[_at(p, moments_of(p.phase_s, grid_s), grid_s, rate, result) for p in placed],
        time="common",
        left_out=tuple(p.id for p in result.performances if p not in placed),
    )


def _at(p: Performance, m: Moments, grid_s: np.ndarray, rate: float, result: Result) -> Performance:
    theta, trans = pose_at(p.body.theta, m.at), values_at(p.body.trans, m.at)
    shaped = body_of(result, hands=False).shape(torch.as_tensor(p.betas))
    local = torch.as_tensor(_rotations(theta))
    joints = shaped.pose(local, torch.as_tensor(trans)).joints.numpy()
    turns = _rotations(pose_at(_vectors(p.turns), m.at))[:, 0]
    return replace(
        p,
        fps=rate,
        body=BodyMotion(theta, trans, joints),
        hands=None if p.hands is None else _hands_at(p.hands, m),
        turns=turns,
        zoom=values_at(p.zoom, m.at),
        frames=values_at(p.frames, m.at),
        inside=m.inside,
        phase_s=grid_s,
    )


def _hands_at(hands: HandTrack, m: Moments) -> HandTrack:
    flat = np.concatenate([hands.wrists[:, :, None], hands.fingers], axis=2)
    turned = pose_at(flat.reshape(len(flat), -1), m.at).reshape(len(m.at), *flat.shape[1:])
    return HandTrack(
        wrists=turned[:, :, 0],
        fingers=turned[:, :, 1:],
        points=values_at(hands.points, m.at),
        seen=hands.seen[np.round(m.at).astype(np.int64)] & m.inside[:, None],
    )


def _rotations(theta: np.ndarray) -> np.ndarray:
    from imocap_core.body.conversions import rotations_from_pose

    return rotations_from_pose(torch.as_tensor(theta)).numpy()


def _vectors(R: np.ndarray) -> np.ndarray:
    from imocap_core.rotations import log

    return log(torch.as_tensor(R)).numpy()

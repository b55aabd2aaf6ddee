"""From an action's artifacts to its performances at common moments, on one body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from imocap_core.artifacts.store import Store
from imocap_core.body import Shaped
from imocap_core.body.conversions import rotations_from_pose
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.errors import WorkFailed
from imocap_core.export.clips import body_of
from imocap_core.export.common_time import on_common_time
from imocap_core.export.sources import read_result
from imocap_core.export.values import Performance, Result
from imocap_core.motion.multiview.common_time import moments_of
from imocap_core.technique.performances import (
    AlignedPerformances,
    at_moments,
    facing_alike,
    to_the_front,
)

Array = NDArray[np.float64]

JOINTS = SMPL_JOINTS[:22]  # a body's keypoints say nothing of SMPL's hand joints


@dataclass(frozen=True, eq=False)
class Gathered:
    """One action's performances.

    instances: facing alike, at the moments of `shared`. own_s (M, N): seconds of each video there.
    shaped: the body that all are put on. fps: moments a second. left_out: who is not among them,
    and why.
    """

    action: str
    instances: AlignedPerformances
    own_s: Array
    shaped: Shaped
    fps: float
    left_out: tuple[str, ...]


def gather(store: Store, action: str, body: Shaped | None = None) -> Gathered:
    """Performances of an action, in a level world (y up), on `body` or the reference's.

    WorkFailed when an artifact is missing or no video has a place on the common axis.
    """
    result = read_result(store, action, "y")
    common = on_common_time(result)
    mirrored = [p.id for p in common.performances if p.id in result.sync.mirrored]
    used = [p for p in common.performances if p.id not in mirrored]
    shaped = body or _body(result)
    R = np.stack([rotations_from_pose(torch.as_tensor(p.body.theta)).numpy() for p in used])
    placed = shaped.pose(torch.as_tensor(R), torch.zeros(3, dtype=torch.float64)).joints.numpy()
    count = len(JOINTS)
    found = AlignedPerformances(
        ids=tuple(p.id for p in used),
        joint_names=JOINTS,
        phase_s=used[0].phase_s,
        R_local=R[:, :, :count],
        joints=(placed - placed[:, :, :1])[:, :, :count],
        inside=np.stack([p.inside for p in used]),
    )
    own = {p.id: p for p in result.performances}
    found = to_the_front(facing_alike(at_moments(found, shared(found.inside))))
    return Gathered(
        action=action,
        instances=found,
        own_s=np.stack([_own_s(own[i], found.phase_s) for i in found.ids]),
        shaped=shaped,
        fps=used[0].fps,
        left_out=(
            *(f"{i}: no place on the common axis" for i in common.left_out),
            *(f"{i}: mirrored" for i in mirrored),
        ),
    )


def shared(inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which moments (N,) to compare, of what M performances show (M, N): those that all show; where
    these are less than half of what two show (one video is short), what two show."""
    shown = inside.sum(0)
    everyone, two = shown == len(inside), shown >= min(2, len(inside))
    return everyone if 2 * everyone.sum() >= two.sum() else two


def several(gathered: Gathered) -> Gathered:
    """The same; WorkFailed unless there are at least two performances to compare."""
    if len(gathered.instances.ids) < 2:
        raise WorkFailed(
            f"{gathered.action} has one performance, and its spread needs two or more: add videos, "
            f"say `repetitions: true` of a long clip in action.yaml, or name a second action"
        )
    return gathered


def _body(result: Result) -> Shaped:
    reference = next(p for p in result.performances if p.id == result.reference)
    return body_of(result, hands=False).shape(torch.as_tensor(reference.betas))


def _own_s(p: Performance, phase_s: Array) -> Array:
    """(N,) seconds of the video's own time at the moments; its ends where it shows nothing."""
    return moments_of(p.phase_s, phase_s).at / p.fps

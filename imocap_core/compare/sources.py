"""From a result to its performances at common moments, on one body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float

from imocap_core.body import Shaped
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.errors import WorkFailed
from imocap_core.motion.multiview.common_time import frame_positions
from imocap_core.result.body import local_rotations
from imocap_core.result.result import ActionResult
from imocap_core.result.video_body import body_model_of
from imocap_core.technique.performances import (
    AlignedPerformances,
    at_moments,
    facing_alike,
    to_the_front,
)

JOINTS = SMPL_JOINTS[:22]  # body keypoints do not determine SMPL's hand joints


@dataclass(frozen=True, eq=False)
class Performances:
    """One action's performances, ready to be compared.

    instances: facing alike, at the moments of `compared_moments`. clock_s (M, N): seconds of each
    video's own clock at these. shaped: the body that all are put on. fps: moments a second.
    left_out: performances not among them, and why.
    """

    action: str
    instances: AlignedPerformances
    clock_s: Float[np.ndarray, "M N"]
    shaped: Shaped
    fps: float
    left_out: tuple[str, ...]


def performers_of(result: ActionResult) -> list[str]:
    """The performers declared of the videos that can be compared, in order of appearance."""
    placed = [v for v in result.on_common_time() if v.id not in result.sync.mirrored]
    return list(dict.fromkeys(v.performer for v in placed if v.performer is not None))


def performances_of(
    result: ActionResult, body: Shaped | None = None, performer: str | None = None
) -> Performances:
    """Performances of an action, or of one performer in it, in a level world (y up), on `body` or
    the reference's.

    WorkFailed when no video has a place on the common axis.
    """
    common = result.levelled("y").on_common_time()
    mirrored = [v.id for v in common if v.id in result.sync.mirrored]
    used = [v for v in common if v.id not in mirrored]
    if performer is not None:
        used = [v for v in used if v.performer == performer]
    shaped = body or _reference_body(result)
    R = np.stack([local_rotations(v.theta) for v in used])
    placed = shaped.pose(torch.as_tensor(R), torch.zeros(3, dtype=torch.float64)).joints.numpy()
    count = len(JOINTS)
    instances = AlignedPerformances(
        ids=tuple(v.id for v in used),
        joint_names=JOINTS,
        phase_s=used[0].phase_s,
        R_local=R[:, :, :count],
        joints=(placed - placed[:, :, :1])[:, :, :count],
        inside=np.stack([v.inside for v in used]),
    )
    moments = compared_moments(instances.inside)
    instances = to_the_front(facing_alike(at_moments(instances, moments)))
    clocks = [
        frame_positions(result[i].phase_s, instances.phase_s).position / result[i].fps
        for i in instances.ids
    ]
    return Performances(
        action=result.action if performer is None else performer,
        instances=instances,
        clock_s=np.stack(clocks),
        shaped=shaped,
        fps=used[0].fps,
        left_out=(
            *(f"{i}: no place on the common axis" for i in common.left_out),
            *(f"{i}: mirrored" for i in mirrored),
        ),
    )


def compared_moments(inside: Bool[np.ndarray, "M N"]) -> Bool[np.ndarray, " N"]:
    """Which of N moments to compare, given which performances show them (M, N).

    The moments that all performances show; where these are fewer than half of those that at least
    two show (one video is short), the latter.
    """
    shown = inside.sum(0)
    everyone, two = shown == len(inside), shown >= min(2, len(inside))
    return everyone if 2 * everyone.sum() >= two.sum() else two


def several(performances: Performances) -> Performances:
    """The same; WorkFailed unless there are at least two performances to compare."""
    if len(performances.instances.ids) < 2:
        raise WorkFailed(
            f"{performances.action} has one performance, and its spread needs two or more: add "
            f"videos, say `repetitions: true` of a long clip in action.yaml, or name a second "
            f"action"
        )
    return performances


def _reference_body(result: ActionResult) -> Shaped:
    reference = result[result.reference]
    return body_model_of(reference, hands=False).shape(torch.as_tensor(reference.betas))

"""Motions and cameras between artifacts and the core: axis-angle there, rotation matrices here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
import torch
from jaxtyping import Int
from torch import Tensor

from imocap_core.artifacts.schemas import (
    AlternativeMotion,
    Camera,
    CommonMotion,
    Keypoints,
    SmplBa,
    StartFit,
    SwappedSides,
    VideoMotion,
)
from imocap_core.motion.kinematics import Body
from imocap_core.motion.monocular.hypotheses import MotionHypothesis
from imocap_core.motion.multiview.cameras import Cameras
from imocap_core.motion.multiview.scene import DeviationSpread, JointMotion, with_intrinsics
from imocap_core.motion.observations import Observation, padded, per_video_view
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms.view import project
from imocap_core.rotations import exp, log, unwrap
from imocap_core.runs import runs

# what the states of `sync.hypotheses.swapped_sides.swapped_by_others` swap
PARTS: dict[int, Literal["above the hips", "legs", "body"]] = {
    1: "above the hips",
    2: "legs",
    3: "body",
}
STATES = {part: state for state, part in PARTS.items()}


def state_of(videos: Sequence[VideoMotion], template: Tensor) -> MotionState:
    """Stored motions as one padded batch; template: gives dtype and device."""
    theta = padded([v.theta.reshape(-1, 24, 3) for v in videos], template)
    trans = padded([v.trans for v in videos], template)
    lengths = torch.tensor([len(v.frames) for v in videos], device=template.device)
    valid = torch.arange(theta.shape[1], device=template.device) < lengths[:, None]
    betas = torch.as_tensor(np.stack([v.betas for v in videos])).to(template)
    return MotionState.of(exp(theta), trans, betas, valid)


def motions_of(
    body: Body, state: MotionState, observations: Sequence[Observation], keypoints: Keypoints
) -> list[VideoMotion]:
    """A batch as stored motions, axis-angle on continuous branches."""
    joints = body.positions(body.joints, state).xyz
    view = per_video_view(observations, state.trans)
    pixels, _ = project(view, body.positions(body.keypoints, state).xyz)
    error = torch.where(view.weight > 0, (pixels - view.xy_px).norm(dim=-1), torch.nan)
    errors = torch.nanmedian(error, dim=-1).values
    motions = []
    for v, video in enumerate(keypoints.videos):
        used = slice(0, len(video.frames))
        motions.append(
            VideoMotion(
                id=video.id,
                frames=video.frames,
                theta=unwrap(log(state.R_local[v, used])).flatten(1).cpu().numpy(),
                betas=state.betas[v].cpu().numpy(),
                trans=state.trans[v, used].cpu().numpy(),
                joints=joints[v, used].cpu().numpy(),
                reprojection_px=errors[v, used].cpu().numpy(),
            )
        )
    return motions


def starts_of(ids: Sequence[str], costs: Sequence[Sequence[float]]) -> list[StartFit]:
    """Every start of every video as it is stored; costs: the objective of the fit from each."""
    return [
        StartFit(video=video, name=f"start {n + 1}", cost=cost, chosen=cost == min(of_video))
        for video, of_video in zip(ids, costs, strict=True)
        for n, cost in enumerate(of_video)
    ]


def alternatives_of(
    body: Body,
    hypotheses: Sequence[Sequence[MotionHypothesis]],
    observations: Sequence[Observation],
    keypoints: Keypoints,
) -> list[AlternativeMotion]:
    """Every video's alternative motions as they are stored."""
    stored = []
    for of_video, observation, video in zip(
        hypotheses, observations, keypoints.videos, strict=True
    ):
        alone = Keypoints(videos=[video])
        for hypothesis in of_video:
            motion = motions_of(body, hypothesis.motion, [observation], alone)[0]
            stored.append(
                AlternativeMotion(name=hypothesis.name, excess_cost=hypothesis.cost, motion=motion)
            )
    return stored


def cameras_of(cameras: Sequence[Camera], template: Tensor) -> Cameras:
    """Stored cameras as one batch; template: gives dtype and device."""
    R, t, K = (np.stack([getattr(camera, name) for camera in cameras]) for name in "RtK")
    return Cameras(*(torch.as_tensor(x).to(template) for x in (R, t, K)))


def smpl_ba_of(
    body: Body,
    motion: JointMotion,
    observations: Sequence[Observation],
    keypoints: Keypoints,
    reference: str,
) -> SmplBa:
    """SMPL-BA's result as an artifact, as it was solved (`mirroring.Participants.as_filmed`)."""
    ids = [video.id for video in keypoints.videos]
    none = np.zeros((0, 3))
    paths = [none if o.centre_m is None else o.centre_m for o in observations]
    solution = (motion.cameras.K, motion.cameras.R, motion.cameras.t)
    rows = zip(ids, *(x.cpu().numpy() for x in solution), paths, strict=True)
    solved = with_intrinsics(observations, motion.cameras)
    return SmplBa(
        reference=reference,
        model=body.model.name,
        model_digest=body.model.digest,
        videos=motions_of(body, motion.state, solved, keypoints),
        cameras=[Camera(id=i, K=K, R=R, t=t, path_m=path) for i, K, R, t, path in rows],
        objective=motion.costs,
        misfit=motion.misfit,
        status=motion.status,
        swapped=_swapped_sides(motion, keypoints),
        common=_stored_common(motion, ids),
    )


def _swapped_sides(motion: JointMotion, keypoints: Keypoints) -> list[SwappedSides]:
    """The stretches of every video whose sides the solve swapped."""
    if not motion.swapped:
        return []
    return [
        SwappedSides(
            id=video.id,
            first_frame=int(video.frames[first]),
            last_frame=int(video.frames[last]),
            part=part,
        )
        for video, states in zip(keypoints.videos, motion.swapped, strict=True)
        for state, part in PARTS.items()
        for first, last in runs(states == state)
    ]


def joint_motion_of(
    result: SmplBa, motions: Sequence[VideoMotion], cameras: Sequence[Camera], template: Tensor
) -> JointMotion:
    """A stored result as the core's.

    Args:
        motions, cameras: the result's, as they were solved (`mirroring.Participants`).
        template: gives dtype and device.
    """
    common, spread = None, None
    if result.common is not None:
        common = _common_state(result.common, template)
        spread = DeviationSpread(result.common.keypoint_sd_m, result.common.rigid_offset_sd)
    return JointMotion(
        state_of(motions, template),
        cameras_of(cameras, template),
        common,
        spread,
        result.objective,
        result.status,
        result.misfit,
        tuple(_states_of(motion, result) for motion in motions),
    )


def _states_of(motion: VideoMotion, result: SmplBa) -> Int[np.ndarray, " T"]:
    """Which sides of a video's detections the solve swapped."""
    states = np.zeros(len(motion.frames), dtype=int)
    for stretch in result.swapped:
        if stretch.id == motion.id:
            states[stretch.covers(motion.frames)] = STATES[stretch.part]
    return states


def _stored_common(motion: JointMotion, ids: list[str]) -> CommonMotion | None:
    if motion.common is None or motion.spread is None:
        return None
    others = motion.common.other_betas[0]
    return CommonMotion(
        ids=ids,
        theta=unwrap(log(motion.common.R_local[0])).flatten(1).cpu().numpy(),
        betas=motion.common.betas[0].cpu().numpy(),
        trans=motion.common.trans[0].cpu().numpy(),
        rigid_offset_sd=motion.spread.offset_sd,
        keypoint_sd_m=motion.spread.keypoints_m,
        other_betas=others.cpu().numpy() if len(others) else None,
    )


def _common_state(common: CommonMotion, template: Tensor) -> MotionState:
    arrays = (common.theta, common.trans, common.betas)
    theta, trans, betas = (torch.as_tensor(x).to(template) for x in arrays)
    valid = torch.ones(1, len(trans), dtype=torch.bool, device=template.device)
    R_local = exp(theta.reshape(1, -1, 24, 3))
    state = MotionState.of(R_local, trans[None], betas[None], valid)
    if common.other_betas is None:
        return state
    return replace(state, other_betas=torch.as_tensor(common.other_betas).to(template)[None])

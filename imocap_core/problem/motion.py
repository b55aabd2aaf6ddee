"""Between artifacts and the core's motion: what the three motion stages share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from imocap_core.artifacts.schemas import (
    Camera,
    CameraMotion,
    InitialSmpl,
    Keypoints,
    SmplBa,
    SyncSummary,
    VideoMotion,
)
from imocap_core.body import load_free_body
from imocap_core.body.layouts import layouts
from imocap_core.io.estimators.by_name import JOINTS
from imocap_core.motion.kinematics import Body
from imocap_core.motion.multiview.consensus import Cameras
from imocap_core.motion.multiview.scene import JointMotion, Scene, through
from imocap_core.motion.multiview.timeline import make_timeline
from imocap_core.motion.observations import Observation, own_view, padded
from imocap_core.motion.prior import load_pose_prior
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms.view import project
from imocap_core.params import FitParams, MotionParams
from imocap_core.rotations import exp, log, unwrap
from imocap_core.sync.warp.reprojection import CalibratedVideo, ReprojectionEvidence

LIKE = torch.zeros((), dtype=torch.float64)


def body_for(keypoints: Keypoints) -> Body:
    """The free body seen through every layout that the videos use."""
    return Body.of(load_free_body(), *layouts_of(keypoints))


def layouts_of(keypoints: Keypoints) -> list[str]:
    """The layouts in use, each once, in order of appearance."""
    return list(dict.fromkeys(v.layout for v in keypoints.videos))


def observations_of(
    body: Body,
    keypoints: Keypoints,
    camera_motion: CameraMotion,
    fit: FitParams,
    joints: dict[str, np.ndarray] | None = None,
) -> list[Observation]:
    """Keypoints in the first frame's image, each video's layout in its place among all.

    ``joints``: monocular 3D joints (T, 24, 3) of the videos that have them.
    """
    columns = {layout: list(body.model.points(layout).columns) for layout in layouts_of(keypoints)}
    ends = np.cumsum([len(kept) for kept in columns.values()])
    place = {
        layout: slice(end - len(columns[layout]), end)
        for layout, end in zip(columns, ends, strict=True)
    }
    found = []
    for video, camera in zip(keypoints.videos, camera_motion.videos, strict=True):
        xy = np.full((len(video.frames), ends[-1], 2), np.nan)
        confidence = np.zeros(xy.shape[:2])
        kept, here = columns[video.layout], place[video.layout]
        xy[:, here], confidence[:, here] = camera.xy_first_px[:, kept], video.confidence[:, kept]
        confidence[~np.isfinite(xy).all(-1)] = 0.0
        known = (joints or {}).get(video.id)
        noise = noise_share_of(video.layout, fit)
        spread = fit.focal_spread if camera.focal_source == "assumed" else 0.0
        found.append(
            Observation(
                xy, confidence, camera.K, video.fps, known,
                noise_share=noise, focal_spread=spread,
            )
        )  # fmt: skip
    return found


def noise_share_of(layout: str, fit: FitParams) -> float:
    """The noise of a layout's detector, a share of the person's size; ValueError names a layout
    that there is not."""
    if unknown := sorted(set(fit.noise_share_of) - set(layouts())):
        raise ValueError(
            f"fit.noise_share_of: expected some of {', '.join(layouts())}, got {unknown[0]}"
        )
    return fit.noise_share_of.get(layout, fit.noise_share)


def scene_of(
    body: Body, observations: Sequence[Observation], sync: SyncSummary, fit: FitParams
) -> Scene:
    """What SMPL-BA keeps fixed, for one set of correspondences."""
    reference = sync.ids.index(sync.reference)
    maps = [m.reference_frame for m in sync.maps]
    trust = [m.confidence for m in sync.maps]
    timeline = make_timeline(maps, trust, sync.lengths[reference])
    prior = load_pose_prior()
    return Scene(body, prior, observations, timeline, trust, reference, fit)


def pictures_of(
    body: Body,
    observations: Sequence[Observation],
    motions: Sequence[VideoMotion],
    cameras: Sequence[Camera],
    params: MotionParams,
) -> ReprojectionEvidence:
    """What every video's detections can be held against: all motions in one world."""
    xyz = body.positions(body.keypoints, state_of(motions)).xyz.numpy()
    films = []
    for o, x, camera in zip(observations, xyz, cameras, strict=True):
        world = (x[: len(o.xy_px)] - camera.t) @ camera.R
        weight = o.confidence / o.sigma_px[:, None] ** 2
        xy = np.where(weight[..., None] > 0, o.xy_px, 0.0)
        films.append(CalibratedVideo(world, xy, weight, camera.K, camera.R, camera.t))
    return ReprojectionEvidence(films, params)


def state_of(videos: Sequence[VideoMotion]) -> MotionState:
    """Stored motions as one padded batch."""
    theta = padded([v.theta.reshape(-1, 24, 3) for v in videos], LIKE)
    trans = padded([v.trans for v in videos], LIKE)
    lengths = torch.tensor([len(v.frames) for v in videos])
    valid = torch.arange(theta.shape[1]) < lengths[:, None]
    betas = torch.as_tensor(np.stack([v.betas for v in videos])).to(LIKE)
    return MotionState.of(exp(theta), trans, betas, valid)


def motions_of(
    body: Body, state: MotionState, observations: Sequence[Observation], keypoints: Keypoints
) -> list[VideoMotion]:
    """The state as stored motions, axis-angle on continuous branches."""
    joints = body.positions(body.joints, state).xyz
    view = own_view(observations, state.trans)
    pixels, _ = project(view, body.positions(body.keypoints, state).xyz)
    error = torch.where(view.weight > 0, (pixels - view.xy_px).norm(dim=-1), torch.nan)
    errors = torch.nanmedian(error, dim=-1).values
    found = []
    for v, video in enumerate(keypoints.videos):
        used = slice(0, len(video.frames))
        found.append(
            VideoMotion(
                id=video.id,
                frames=video.frames,
                theta=unwrap(log(state.R_local[v, used])).flatten(1).numpy(),
                betas=state.betas[v].numpy(),
                trans=state.trans[v, used].numpy(),
                joints=joints[v, used].numpy(),
                reprojection_px=errors[v, used].numpy(),
            )
        )
    return found


def smpl_ba_of(
    body: Body,
    motion: JointMotion,
    observations: Sequence[Observation],
    keypoints: Keypoints,
    reference: str,
) -> SmplBa:
    """The core's joint motion as an artifact."""
    cameras = [
        Camera(id=video.id, K=K.numpy(), R=R.numpy(), t=t.numpy())
        for video, K, R, t in zip(
            keypoints.videos, motion.cameras.K, motion.cameras.R, motion.cameras.t, strict=True
        )
    ]
    seen = through(observations, motion.cameras)
    return SmplBa(
        reference=reference,
        model=body.model.name,
        model_digest=body.model.digest,
        videos=motions_of(body, motion.state, seen, keypoints),
        cameras=cameras,
        objective=motion.costs,
        misfit=motion.misfit,
        status=motion.status,
    )


def cameras_of(cameras: Sequence[Camera]) -> Cameras:
    """An artifact's cameras as the core's."""
    R, t, K = (np.stack([getattr(camera, name) for camera in cameras]) for name in "RtK")
    return Cameras(*(torch.as_tensor(x).to(LIKE) for x in (R, t, K)))


def evidence_joints(initial: InitialSmpl) -> dict[str, np.ndarray]:
    """Monocular 3D joints that stay evidence in SMPL-BA: those a real estimator gave."""
    return {v.id: v.joints for v in initial.videos if initial.source.get(v.id, "") in JOINTS}

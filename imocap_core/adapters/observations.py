"""Detections, motions and cameras between artifacts and the core."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.artifacts.schemas import (
    AlternativeMotion,
    Camera,
    CameraMotion,
    CommonMotion,
    InitialSmpl,
    Keypoints,
    PathUnit,
    SmplBa,
    StartFit,
    VideoCameraMotion,
    VideoMotion,
)
from imocap_core.body import load_free_body
from imocap_core.body.layouts import layouts
from imocap_core.io.readers.smpl_estimators import JOINT_READERS
from imocap_core.motion.monocular.hypotheses import MotionHypothesis
from imocap_core.motion.multiview import scene
from imocap_core.motion.observations import Observation, padded, per_video_view
from imocap_core.motion.state import Body, MotionState
from imocap_core.motion.terms.view import project
from imocap_core.params import FitParams
from imocap_core.rotations import exp, log, unwrap

UNKNOWN_PATH_M = 0.3  # of the performer's place, where a camera moves along an unknown path


def body_for(keypoints: Keypoints, device: torch.device | str = "cpu") -> Body:
    """The free body with the keypoints of every layout that the videos use.

    device: of its tensors, and so of all that is computed with it.
    """
    return Body.of(load_free_body(device), *layouts_of(keypoints))


def layouts_of(keypoints: Keypoints) -> list[str]:
    """The layouts in use, each once, in order of appearance."""
    return list(dict.fromkeys(v.layout for v in keypoints.videos))


def columns_of(body: Body, keypoints: Keypoints) -> dict[str, tuple[list[int], slice]]:
    """Of every layout in use the points that the body has, and their columns among the keypoints of
    all layouts."""
    columns, end = {}, 0
    for layout in layouts_of(keypoints):
        used = list(body.model.points(layout).columns)
        columns[layout] = used, slice(end, end + len(used))
        end += len(used)
    return columns


def observations_of(
    body: Body,
    keypoints: Keypoints,
    camera_motion: CameraMotion,
    fit: FitParams,
    joints: Mapping[str, Float[np.ndarray, "_ 24 3"]] | None = None,
    units: Sequence[PathUnit] = (),
) -> list[Observation]:
    """Keypoints in the first frame's image, each video's layout in its columns among all.

    Args:
        joints: monocular 3D joints of the videos that have them.
        units: of the paths of moving cameras; a path without a unit is not used.
    """
    metric = {unit.id: unit for unit in units}
    columns = columns_of(body, keypoints)
    width = max((here.stop for _, here in columns.values()), default=0)
    observations, people = [], performers_of(keypoints)
    for video, camera in zip(keypoints.videos, camera_motion.videos, strict=True):
        xy = np.full((len(video.frames), width, 2), np.nan)
        confidence = np.zeros(xy.shape[:2])
        used, here = columns[video.layout]
        xy[:, here], confidence[:, here] = camera.xy_first_px[:, used], video.confidence[:, used]
        confidence[~np.isfinite(xy).all(-1)] = 0.0
        centre, place_sd = path_of(camera, metric.get(video.id))
        observations.append(
            Observation(
                xy,
                confidence,
                camera.K,
                video.fps,
                (joints or {}).get(video.id),
                noise_share=noise_share_of(video.layout, fit),
                focal_spread=fit.focal_spread if camera.focal_source == "assumed" else 0.0,
                performer=people.index(video.performer),
                centre_m=centre,
                place_sd_m=place_sd,
            )
        )
    return observations


def performers_of(keypoints: Keypoints) -> list[str | None]:
    """The performers that are declared, in order of appearance; None: not declared."""
    return list(dict.fromkeys(video.performer for video in keypoints.videos))


def path_of(
    camera: VideoCameraMotion, unit: PathUnit | None
) -> tuple[Float[np.ndarray, "T 3"] | None, Float[np.ndarray, " T"] | None]:
    """Places of a moving camera in metres, and the standard deviation that the performer's place
    has of them; both None on one spot, the first where the path is unknown."""
    if camera.motion != "translating":
        return None, None
    if unit is None or not len(camera.path):
        return None, np.full(len(camera.zoom), UNKNOWN_PATH_M)
    centre = unit.unit_m * camera.path
    from_middle = np.linalg.norm(centre - centre.mean(axis=0), axis=1)
    return centre, np.hypot(unit.unit_m * camera.path_sd, unit.relative_sd * from_middle)


def noise_share_of(layout: str, fit: FitParams) -> float:
    """The noise of a layout's detector, as a share of the person's size.

    Raises:
        ValueError: `fit.noise_share_of` names an unknown layout.
    """
    check_layouts("fit.noise_share_of", fit.noise_share_of)
    return fit.noise_share_of.get(layout, fit.noise_share)


def fit_of(keypoints: Keypoints, fit: FitParams) -> FitParams:
    """The parameters with the shape prior of the videos' layouts, the strongest of several.

    Raises:
        ValueError: `fit.shape_prior_of` names an unknown layout.
    """
    check_layouts("fit.shape_prior_of", fit.shape_prior_of)
    weights = [fit.shape_prior_of.get(x, fit.shape_prior) for x in layouts_of(keypoints)]
    return replace(fit, shape_prior=max(weights, default=fit.shape_prior))


def fit_of_single_views(
    keypoints: Keypoints, fit: FitParams, joints_known: bool, least_shape_prior: float
) -> FitParams:
    """The parameters of fits to single videos: without 3D joints a view does not tell proportions
    from depth, and the shape prior has at least a given weight."""
    of_layouts = fit_of(keypoints, fit)
    if joints_known:
        return of_layouts
    return replace(of_layouts, shape_prior=max(of_layouts.shape_prior, least_shape_prior))


def check_layouts(field: str, table: Mapping[str, float]) -> None:
    """ValueError where a parameter's table names an unknown layout."""
    if unknown := sorted(set(table) - set(layouts())):
        raise ValueError(f"{field}: expected some of {', '.join(layouts())}, got {unknown[0]}")


def estimated_joints(initial: InitialSmpl) -> dict[str, Float[np.ndarray, "_ 24 3"]]:
    """Monocular 3D joints that stay evidence in SMPL-BA: those of an estimator, by video."""
    return {v.id: v.joints for v in initial.videos if initial.source.get(v.id, "") in JOINT_READERS}


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
    joints = body.positions(body.joints, state)
    view = per_video_view(observations, state.trans)
    pixels, _ = project(view, body.positions(body.keypoints, state))
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


def smpl_ba_of(
    body: Body,
    motion: scene.JointMotion,
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
    solved = scene.with_intrinsics(observations, motion.cameras)
    return SmplBa(
        reference=reference,
        model=body.model.name,
        model_digest=body.model.digest,
        videos=motions_of(body, motion.state, solved, keypoints),
        cameras=[Camera(id=i, K=K, R=R, t=t, path_m=path) for i, K, R, t, path in rows],
        objective=motion.costs,
        misfit=motion.misfit,
        status=motion.status,
        common=_stored_common(motion, ids),
    )


def joint_motion_of(
    result: SmplBa, motions: Sequence[VideoMotion], cameras: Sequence[Camera], template: Tensor
) -> scene.JointMotion:
    """A stored result as the core's.

    Args:
        motions, cameras: the result's, as they were solved (`mirroring.Participants`).
        template: gives dtype and device.
    """
    common, spread = None, None
    if result.common is not None:
        common = _common_state(result.common, template)
        spread = scene.DeviationSpread(result.common.keypoint_sd_m, result.common.rigid_offset_sd)
    R, t, K = (np.stack([getattr(camera, name) for camera in cameras]) for name in "RtK")
    return scene.JointMotion(
        state_of(motions, template),
        scene.Cameras(*(torch.as_tensor(x).to(template) for x in (R, t, K))),
        common,
        spread,
        result.objective,
        result.status,
        result.misfit,
    )


def _stored_common(motion: scene.JointMotion, ids: list[str]) -> CommonMotion | None:
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

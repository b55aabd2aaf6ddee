"""uncertainty: how far every joint may be off, and what the videos leave open."""

from __future__ import annotations

from imocap_core.artifacts.schemas import (
    CameraMotion,
    InitialSmpl,
    Keypoints,
    RefineSync,
    Uncertainty,
)
from imocap_core.cli import stage_main
from imocap_core.motion.posterior.noise import Noise
from imocap_core.motion.posterior.observability import observe
from imocap_core.motion.posterior.uncertainty import uncertainty
from imocap_core.params import Params
from imocap_core.pipeline.stage import Context, Inputs
from imocap_core.problem.mirroring import joint_work
from imocap_core.problem.motion import (
    body_for,
    cameras_of,
    evidence_joints,
    observations_of,
    scene_of,
    state_of,
)
from imocap_core.problem.uncertainty import Claims, uncertainty_of
from imocap_core.problem.uncertainty_groups import Group, groups_of


def run(ctx: Context, inputs: Inputs, params: Params) -> Uncertainty:
    """The posterior of the loop's result; a video kept out of it is looked at by itself."""
    refined = inputs.get(RefineSync)
    groups = groups_of(
        inputs.get(Keypoints), inputs.get(CameraMotion), inputs.get(InitialSmpl), refined
    )
    claims = []
    for k, group in enumerate(groups):
        said = f"the posterior of {', '.join(v.id for v in group.keypoints.videos)}"
        ctx.progress(k / len(groups), said)
        claims.append(claims_of(group, params))
    return uncertainty_of(claims, inputs.get(Keypoints), refined, params.uncertainty)


def claims_of(group: Group, params: Params) -> Claims:
    """Covariances and viewpoints of videos that were solved together."""
    body = body_for(group.keypoints)
    work = joint_work(group.keypoints, group.camera_motion, group.initial, group.sync, body.model)
    observations = observations_of(
        body, work.keypoints, work.camera_motion, params.fit, evidence_joints(work.initial)
    )
    state, cameras = (
        state_of(work.motions_in(group.motions)),
        cameras_of(work.cameras_in(group.cameras)),
    )
    scene = scene_of(body, observations, work.sync_in(group.sync), params.fit).through(cameras)
    noise = Noise(params.uncertainty)
    found = uncertainty(scene, state, cameras, params.motion, noise)
    left_open = observe(
        scene,
        state,
        cameras,
        found,
        params.motion,
        near_limit_deg=params.uncertainty.near_limit_deg,
        evidence_share=noise.evidence_share(scene.fps),
    )
    return Claims(work, found.covariances_m2, left_open)


if __name__ == "__main__":
    raise SystemExit(stage_main("uncertainty"))

"""smpl_ba: the motion of every video and all cameras, jointly (Eq. 8)."""

from __future__ import annotations

from imocap_core.artifacts.schemas import CameraMotion, InitialSmpl, Keypoints, SmplBa, Sync
from imocap_core.cli import stage_main
from imocap_core.motion.multiview.joint import recover_motion
from imocap_core.params import Params
from imocap_core.pipeline.stage import Context, Inputs
from imocap_core.problem.mirroring import joint_work
from imocap_core.problem.motion import (
    body_for,
    evidence_joints,
    observations_of,
    scene_of,
    smpl_ba_of,
    state_of,
)


def run(ctx: Context, inputs: Inputs, params: Params) -> SmplBa:
    """One pass of SMPL-BA on the first correspondences."""
    keypoints, initial, sync = inputs.get(Keypoints), inputs.get(InitialSmpl), inputs.get(Sync)
    body = body_for(keypoints)
    work = joint_work(keypoints, inputs.get(CameraMotion), initial, sync, body.model)
    joints = evidence_joints(work.initial)
    observations = observations_of(body, work.keypoints, work.camera_motion, params.fit, joints)
    motion = recover_motion(
        scene_of(body, observations, work.sync_in(sync), params.fit),
        state_of(work.initial.videos),
        params.motion,
        progress=lambda said: ctx.progress(0.5, said),
    )
    return work.out(smpl_ba_of(body, motion, observations, work.keypoints, sync.reference))


if __name__ == "__main__":
    raise SystemExit(stage_main("smpl_ba"))

"""refine_sync: sync and SMPL-BA in turn until the correspondences settle (section 3.3)."""

from __future__ import annotations

from imocap_core.artifacts.schemas import (
    CameraMotion,
    InitialSmpl,
    Keypoints,
    RefineSync,
    Round,
    SmplBa,
    Sync,
    SyncSummary,
)
from imocap_core.cli import stage_main
from imocap_core.motion.multiview.alternation import Alternation, Turn, alternate
from imocap_core.motion.multiview.joint import recover_motion
from imocap_core.motion.state import MotionState
from imocap_core.params import Params
from imocap_core.pipeline.stage import Context, Inputs
from imocap_core.problem.hints import hints_of
from imocap_core.problem.mirroring import joint_work
from imocap_core.problem.motion import (
    body_for,
    cameras_of,
    evidence_joints,
    observations_of,
    pictures_of,
    scene_of,
    smpl_ba_of,
    state_of,
)
from imocap_core.problem.synchronisation import synchronise_motions
from imocap_core.sync.warp.reprojection import ReprojectionEvidence


def run(ctx: Context, inputs: Inputs, params: Params) -> RefineSync:
    """All rounds; round 0 is the single pass."""
    keypoints, initial = inputs.get(Keypoints), inputs.get(InitialSmpl)
    first_sync, first_motion = inputs.get(Sync), inputs.get(SmplBa)
    body = body_for(keypoints)
    work = joint_work(keypoints, inputs.get(CameraMotion), initial, first_sync, body.model)
    observations = observations_of(
        body, work.keypoints, work.camera_motion, params.fit, evidence_joints(work.initial)
    )
    hints = hints_of(*ctx.hints(), keypoints, str(ctx.action_file()))
    rounds_begun = 0

    def pictures(motion: SmplBa) -> ReprojectionEvidence:
        motions, cameras = work.motions_in(motion.videos), work.cameras_in(motion.cameras)
        return pictures_of(body, observations, motions, cameras, params.motion)

    def synchronise(motion: SmplBa) -> Sync:
        nonlocal rounds_begun
        rounds_begun += 1
        ctx.progress(rounds_begun / (params.refine.max_rounds + 1), f"round {rounds_begun}: sync")
        return synchronise_motions(
            motion.videos,
            keypoints,
            params.sync,
            ctx.rng(),
            reference=first_sync.reference,
            decided=first_sync,
            hints=hints,
            reprojection=pictures(motion) if params.refine.evidence == "pictures" else None,
        )

    def recover(sync: Sync, motion: SmplBa) -> SmplBa:
        ctx.progress(rounds_begun / (params.refine.max_rounds + 1), f"round {rounds_begun}: motion")
        scene = scene_of(body, observations, work.sync_in(sync), params.fit)
        state: MotionState = state_of(work.motions_in(motion.videos))
        cameras = cameras_of(work.cameras_in(motion.cameras))
        found = recover_motion(scene, state, params.motion, cameras=cameras)
        return work.out(smpl_ba_of(body, found, observations, work.keypoints, sync.reference))

    done = alternate(
        Turn(first_sync, first_motion, first_motion.misfit, 0.0),
        synchronise,
        recover,
        maps=lambda sync: [m.reference_frame for m in sync.maps],
        cost=lambda motion: motion.misfit,
        max_rounds=params.refine.max_rounds if len(keypoints.videos) > 1 else 0,
        settled_frames=params.refine.settled_frames,
    )
    return _as_artifact(done)


def _as_artifact(done: Alternation[Sync, SmplBa]) -> RefineSync:
    best = done.turns[done.best]
    return RefineSync(
        rounds=[
            Round(
                sync=_summary(turn.sync),
                motion=turn.motion,
                cost=turn.cost,
                sync_change_frames=turn.change_frames,
            )
            for turn in done.turns
        ],
        best=done.best,
        sync=done.sync,
        motion=best.motion,
        status=done.status,
    )


def _summary(sync: Sync) -> SyncSummary:
    return SyncSummary.model_validate({n: getattr(sync, n) for n in SyncSummary.model_fields})


if __name__ == "__main__":
    raise SystemExit(stage_main("refine_sync"))

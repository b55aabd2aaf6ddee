"""refine_sync: sync and SMPL-BA in turn until the correspondences settle (section 3.3)."""

from __future__ import annotations

from functools import partial

import numpy as np
from jaxtyping import Float

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
from imocap_core.motion.multiview.alternation import Alternation, LoopRound, alternate
from imocap_core.motion.multiview.scene import JointMotion
from imocap_core.params import Params
from imocap_core.pipeline.stage import Context, Inputs
from imocap_core.problem.event import calibrated_round, can_calibrate
from imocap_core.problem.event_timing import with_one_offset
from imocap_core.problem.ground import with_ground, with_hands_on_ground
from imocap_core.problem.hints import hints_of
from imocap_core.problem.joint import JointProblem, problem_of
from imocap_core.problem.loop_confidence import with_first_repetitions, with_independent_confidence
from imocap_core.problem.sound import with_sound
from imocap_core.problem.synchronisation import rates_of_motions, summary_of, synchronise_motions
from imocap_core.process import release_freed_memory, release_if_large


def run(ctx: Context, inputs: Inputs, params: Params) -> RefineSync:
    """All rounds; round 0 is the single pass."""
    keypoints, single_pass = inputs.get(Keypoints), inputs.get(SmplBa)
    cameras, initial = inputs.get(CameraMotion), inputs.get(InitialSmpl)
    first_sync, sound_start_s = _without_matrices(inputs)
    problem = problem_of(
        keypoints,
        cameras,
        initial,
        first_sync,
        params.fit,
        params.motion,
        event=ctx.event(),
        device=ctx.device,
    )
    first = problem.solution(single_pass)
    begin, event = LoopRound(first_sync, first, first.misfit, 0.0), None
    if ctx.event() and can_calibrate(problem, first):
        loop, event = calibrated_round(
            problem,
            keypoints,
            begin,
            inputs.get(Sync),
            params.event,
            lambda what: ctx.progress(0.3, what),
        )
    else:
        loop = _in_turn(ctx, inputs, problem, begin, sound_start_s, params)
    result = _as_artifact(loop, problem, single_pass)
    motion = with_ground(result.motion, keypoints, cameras, result.sync.excluded, params.fit)
    motion = with_hands_on_ground(motion, problem.scene.body.model, result.sync)
    matches = with_first_repetitions(result.sync, first_sync)
    return result.model_copy(update={"motion": motion, "sync": matches, "event": event})


def _without_matrices(inputs: Inputs) -> tuple[SyncSummary, Float[np.ndarray, " M"] | None]:
    """The first synchronisation without what makes it large, and when each video began by its
    sound."""
    sync = inputs.get(Sync)
    inputs.forget(Sync)
    return summary_of(sync), sync.sound_start_s


def _in_turn(
    ctx: Context,
    inputs: Inputs,
    problem: JointProblem,
    begin: LoopRound[SyncSummary, JointMotion],
    sound_start_s: Float[np.ndarray, " M"] | None,
    params: Params,
) -> Alternation[Sync, SyncSummary, JointMotion]:
    """Synchronisation and SMPL-BA in turn."""
    keypoints, initial, first_sync = inputs.get(Keypoints), inputs.get(InitialSmpl), begin.sync
    hints = hints_of(*ctx.hints(), keypoints, str(ctx.action_file()))
    if sound_start_s is not None:
        hints = with_sound(hints, sound_start_s, keypoints)
    by_pictures = params.refine.evidence == "pictures"
    monocular = [video.joints for video in initial.videos]
    rates = rates_of_motions(monocular, keypoints, params.sync, hints)
    rounds_begun = 0

    def progress(what: str) -> None:
        share = rounds_begun / (params.refine.max_rounds + 1)
        ctx.progress(share, f"round {rounds_begun}: {what}")

    def synchronise(motion: JointMotion) -> Sync:
        nonlocal rounds_begun
        rounds_begun += 1
        progress("sync")
        release_if_large()  # of the motion, which needs other sizes
        sync = synchronise_motions(
            problem.filmed_joints(motion),
            keypoints,
            params.sync,
            ctx.rng(),
            reference=first_sync.reference,
            decided=first_sync,
            hints=hints,
            reprojection=problem.reprojection_evidence(motion) if by_pictures else None,
            rates=rates,
        )
        sync = with_independent_confidence(sync, first_sync, motion.spread)
        return with_one_offset(sync, keypoints, sound_start_s) if ctx.event() else sync

    def solve(what: str) -> None:
        progress(f"motion, {what}")
        release_if_large()

    def recover(sync: Sync, motion: JointMotion) -> JointMotion:
        progress("motion")
        release_freed_memory()  # of the synchronisation, which needs other sizes
        return problem.recovered(sync, motion, solve)

    return alternate(
        begin,
        partial(inputs.get, Sync),
        synchronise,
        recover,
        outline=summary_of,
        maps=lambda sync: [m.reference_frame for m in sync.maps],
        cost=lambda motion: motion.misfit,
        max_rounds=params.refine.max_rounds if len(keypoints.videos) > 1 else 0,
        settled_frames=params.refine.settled_frames,
    )


def _as_artifact(
    loop: Alternation[Sync, SyncSummary, JointMotion],
    problem: JointProblem,
    single_pass: SmplBa,
) -> RefineSync:
    """All rounds as they are stored; common motion and ground are the result's alone."""
    motions = [single_pass, *(problem.result(r.motion) for r in loop.rounds[1:])]
    return RefineSync(
        rounds=[
            Round(
                sync=round_.sync,
                motion=motion.model_copy(update={"common": None, "ground": None}),
                cost=round_.cost,
                sync_change_frames=round_.change_frames,
            )
            for round_, motion in zip(loop.rounds, motions, strict=True)
        ],
        best=loop.best,
        sync=loop.sync,
        motion=motions[loop.best],
        status=loop.status,
    )


if __name__ == "__main__":
    raise SystemExit(stage_main("refine_sync"))

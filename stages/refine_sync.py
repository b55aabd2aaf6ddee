"""refine_sync: sync and SMPL-BA in turn until the correspondences settle (section 3.3)."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from jaxtyping import Float

from imocap_core.adapters.event import as_one_event, calibrated_round
from imocap_core.adapters.ground import with_ground, with_hands_on_ground
from imocap_core.adapters.hints import hints_of, with_sound
from imocap_core.adapters.hypotheses import unfit_videos
from imocap_core.adapters.joint import JointProblem, problem_of, shows_one_motion
from imocap_core.adapters.loop_sync import (
    LoopSync,
    with_first_repetitions,
    with_independent_confidence,
)
from imocap_core.adapters.participants import known_mirrors
from imocap_core.adapters.redetection import is_changed, with_second_look
from imocap_core.adapters.synchronisation import evidence_of, summary_of
from imocap_core.artifacts.schemas import (
    CameraMotion,
    InitialSmpl,
    Keypoints,
    Redetect,
    RefineSync,
    Round,
    SmplBa,
    Sync,
    SyncSummary,
)
from imocap_core.cli import stage_main
from imocap_core.motion.multiview.alternation import Alternation, LoopRound, LoopSteps, alternate
from imocap_core.motion.multiview.scene import JointMotion
from imocap_core.motion.multiview.smpl_ba import solve_jointly
from imocap_core.params import Params
from imocap_core.pipeline.stage import Context, Inputs
from imocap_core.process import release_freed_memory, release_if_large
from imocap_core.sync import estimated_rates


def run(ctx: Context, inputs: Inputs, params: Params) -> RefineSync:
    """All rounds; round 0 is the single pass."""
    inputs = with_second_look(inputs)
    keypoints, single_pass = inputs.get(Keypoints), inputs.get(SmplBa)
    first_sync, sound_start_s = _without_matrices(inputs)
    problem = _problem(ctx, inputs, params, first_sync)
    first = problem.solution(single_pass)
    begin, calibrated, event = LoopRound(first_sync, first, first.misfit, 0.0), None, None
    if ctx.event():
        progress = partial(ctx.progress, 0.3)
        calibrated = calibrated_round(problem, keypoints, begin, inputs.get(Sync), progress)
    if calibrated is not None:
        loop, event = calibrated
    else:
        loop, problem = _in_turn(ctx, inputs, problem, begin, sound_start_s, params)
        if ctx.event() is None:
            loop, event = as_one_event(problem, keypoints, loop, partial(ctx.progress, 0.9))
    result = _as_artifact(loop, problem, single_pass)
    cameras, excluded = inputs.get(CameraMotion), result.sync.excluded
    motion = with_ground(result.motion, keypoints, cameras, excluded, params.fit)
    motion = with_hands_on_ground(motion, problem.scene.body.model, result.sync)
    return result.model_copy(update={"motion": motion, "event": event})


def _problem(ctx: Context, inputs: Inputs, params: Params, sync: SyncSummary) -> JointProblem:
    """The joint motion's problem with some correspondences."""
    return problem_of(
        inputs.get(Keypoints),
        inputs.get(CameraMotion),
        inputs.get(InitialSmpl),
        sync,
        params.fit,
        params.motion,
        event=bool(ctx.event()),
        device=ctx.device,
    )


def _without_matrices(inputs: Inputs) -> tuple[SyncSummary, Float[np.ndarray, " M"] | None]:
    """The first synchronisation without what makes it large, and when each video began by its
    sound."""
    sync = inputs.get(Sync)
    inputs.forget(Sync)
    return summary_of(sync), sync.sound_start_s


def _loop_sync(
    ctx: Context, inputs: Inputs, sound_start_s: Float[np.ndarray, " M"] | None, params: Params
) -> LoopSync:
    """What the loop's synchronisations go by."""
    keypoints, initial = inputs.get(Keypoints), inputs.get(InitialSmpl)
    hints = hints_of(*ctx.hints(), keypoints, str(ctx.action_file()))
    if sound_start_s is not None:
        hints = with_sound(hints, sound_start_s, keypoints)
    monocular = [video.joints for video in initial.videos]
    evidence = evidence_of(monocular, keypoints, hints, unfit=unfit_videos(initial))
    return LoopSync(
        keypoints,
        inputs.get(CameraMotion),
        initial,
        params.sync,
        hints,
        estimated_rates(evidence, params.sync),
        by_pictures=params.refine.evidence == "pictures",
        event=bool(ctx.event()),
        sound_start_s=sound_start_s,
        declared=known_mirrors(ctx.mirrored(), keypoints),
        rng=ctx.rng,
    )


def _in_turn(
    ctx: Context,
    inputs: Inputs,
    problem: JointProblem,
    single_pass: LoopRound[SyncSummary, JointMotion],
    sound_start_s: Float[np.ndarray, " M"] | None,
    params: Params,
) -> tuple[Alternation[Sync, SyncSummary, JointMotion], JointProblem]:
    """Synchronisation and SMPL-BA in turn, and the problem on the time axis that they end on."""
    most_rounds = params.refine.max_rounds if len(inputs.get(Keypoints).videos) > 1 else 0
    if not most_rounds:
        status = "has no rounds; the result is that of the first joint solve"
        return Alternation([single_pass], 0, inputs.get(Sync), status), problem
    loop_sync, rounds_begun = _loop_sync(ctx, inputs, sound_start_s, params), 0

    def progress(what: str) -> None:
        ctx.progress(rounds_begun / (most_rounds + 1), f"round {rounds_begun}: {what}")

    def solving(what: str) -> None:
        progress(f"motion, {what}")
        release_if_large()

    def solve(sync: SyncSummary) -> tuple[JointProblem, JointMotion]:
        again = _problem(ctx, inputs, params, sync)
        return again, solve_jointly(again.scene, again.start, again.options, solving)

    progress("videos and time axis")
    begun, first_of_loop = loop_sync.beginning(problem, single_pass, solve)
    first_sync = begun.single_pass.sync

    def synchronise(motion: JointMotion) -> Sync:
        nonlocal rounds_begun, first_of_loop
        rounds_begun += 1
        progress("sync")
        release_if_large()  # of the motion, which needs other sizes
        sync, first_of_loop = first_of_loop or loop_sync.of_motion(begun, motion), None
        sync = with_independent_confidence(sync, first_sync, motion.spread)
        return with_first_repetitions(sync, first_sync)

    def recover(sync: Sync, motion: JointMotion) -> JointMotion:
        progress("motion")
        release_freed_memory()  # of the synchronisation, which needs other sizes
        restart = shows_one_motion(motion)
        return begun.problem.recovered(sync, motion, solving, restart=restart)

    steps = LoopSteps(
        partial(loop_sync.first_of, begun) if begun.moved else partial(inputs.get, Sync),
        synchronise,
        recover,
        outline=summary_of,
        maps=lambda sync: [m.reference_frame for m in sync.maps],
        cost=lambda motion: motion.misfit,
    )
    loop = alternate(
        begun.single_pass,
        steps,
        max_rounds=most_rounds,
        settled_frames=params.refine.settled_frames,
        least_rounds=int(begun.moved or is_changed(inputs.get(Redetect))),
    )
    if begun.moved and loop.best == 0:  # its videos or axis are others than the single pass has
        first = loop.rounds[0]
        if first.motion.common is None:  # of another axis
            motion = begun.problem.recovered(first_sync, first.motion, solving, restart=False)
            first = replace(first, motion=motion, cost=motion.misfit)
        loop = replace(loop, rounds=[single_pass, first, *loop.rounds[1:]], best=1)
    return replace(loop, rounds=[single_pass, *loop.rounds[1:]]), begun.problem


def _as_artifact(
    loop: Alternation[Sync, SyncSummary, JointMotion], problem: JointProblem, single_pass: SmplBa
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

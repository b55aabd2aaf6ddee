"""evaluate: every answer against the truth, where there is one, and the report folder."""

from __future__ import annotations

from imocap_core.artifacts.schemas import (
    CameraMotion,
    Evaluate,
    Hands,
    InitialSmpl,
    Keypoints,
    RefineSync,
    SmplBa,
    Sync,
    Uncertainty,
)
from imocap_core.body import Model, load_free_body
from imocap_core.cli import stage_main
from imocap_core.evaluate.scoreboard import (
    StageResult,
    against_truth,
    cycle_row,
    score,
    true_positions,
)
from imocap_core.figures.bodies import body_points
from imocap_core.figures.contact_sheets import SheetVideo
from imocap_core.io.pose2sim_truth import has_pose2sim_truth, read_pose2sim_truth
from imocap_core.io.truth import Truth, read_truth
from imocap_core.metrics.scoring import ALL_VIDEOS, ScoreRow, over_videos
from imocap_core.params import Params
from imocap_core.pipeline.stage import Context, Inputs
from imocap_core.report.evaluation_figures import draw_contact_sheets, draw_numbers
from imocap_core.report.files import Picture, write_report
from imocap_core.report.hand_tables import hand_rows, hand_tables
from imocap_core.report.observability_text import observability_markdown, open_table
from imocap_core.report.tables import long_table, metric_tables, round_table, video_table
from imocap_core.report.trust_tables import trust_tables
from imocap_core.report.uncertainty_tables import normalised_rows, uncertainty_tables

OPEN = "observability.md"


def run(ctx: Context, inputs: Inputs, params: Params) -> Evaluate:
    """Score the monocular start, the single pass and the loop; write tables and figures."""
    keypoints, camera_motion = inputs.get(Keypoints), inputs.get(CameraMotion)
    sync, refined = inputs.get(Sync), inputs.get(RefineSync)
    truth = truth_of(ctx, keypoints)
    answers = answers_of(inputs.get(InitialSmpl), sync, inputs.get(SmplBa), refined)
    model = load_free_body()

    ctx.progress(0.1, "scoring")
    rows = [row for a in answers for row in score_of(a, keypoints, camera_motion, truth, model)]
    rows += [cycle_row("single pass", sync), cycle_row("after loop", refined.sync)]
    claimed, motions = inputs.get(Uncertainty), refined.motion.videos
    rows += normalised_rows("after loop", claimed, motions, truth)
    rows += hand_rows("after loop", inputs.get(Hands), truth)
    summary = over_videos(rows)
    round_errors = [
        against_truth(
            StageResult("round", r.motion.videos, r.motion.cameras, r.sync), keypoints, truth
        )
        for r in refined.rounds
    ]
    tables = [
        *metric_tables(rows, summary),
        *hand_tables([*rows, *summary]),
        *([round_table(refined, round_errors)] if len(refined.rounds) > 1 else []),
        video_table(keypoints, camera_motion, refined),
        *trust_tables(refined.sync),
        open_table(claimed),
        *uncertainty_tables(claimed, motions, truth, [*rows, *summary]),
    ]
    pictures: list[Picture] = []
    if params.evaluate.figures:
        ctx.progress(0.3, "drawing numbers")
        positions = true_positions(refined.sync, truth)
        pictures += draw_numbers(ctx.report, sync, refined, answers, truth, positions, round_errors)
        ctx.progress(0.6, "drawing over the videos")
        pictures += draw_contact_sheets(
            ctx.report, shots_of(ctx, keypoints, camera_motion, answers, model), refined, model
        )
    every = long_table([*(row for row in rows if row.video != ALL_VIDEOS), *summary])
    files = write_report(
        ctx.report, ctx.action_file().parent.name, lead_of(refined), tables, every, pictures
    )
    name = ctx.action_file().parent.name
    (ctx.report / OPEN).write_text(observability_markdown(name, claimed), encoding="utf-8")
    return Evaluate(tables=[*tables, every], files=sorted([*files, OPEN]))


def truth_of(ctx: Context, keypoints: Keypoints) -> Truth | None:
    """What action.yaml names as truth, or a calibrated rig's files beside it."""
    named = ctx.truth()
    used_frames = {v.id: v.frames for v in keypoints.videos}
    if named is not None:
        return read_truth(named, used_frames)
    folder = ctx.action_file().parent
    if has_pose2sim_truth(folder):
        return read_pose2sim_truth(folder, used_frames)
    return None


def answers_of(
    initial: InitialSmpl, sync: Sync, single: SmplBa, refined: RefineSync
) -> list[StageResult]:
    """The three answers that are compared, in the order in which they come about."""
    return [
        StageResult("monocular", initial.videos),
        StageResult("single pass", single.videos, single.cameras, sync),
        StageResult("after loop", refined.motion.videos, refined.motion.cameras, refined.sync),
    ]


def score_of(
    answer: StageResult,
    keypoints: Keypoints,
    camera_motion: CameraMotion,
    truth: Truth | None,
    model: Model,
) -> list[ScoreRow]:
    """Every metric of one answer."""
    intrinsics = {c.id: c.K for c in answer.cameras or camera_motion.videos}
    points = {
        seen.id: body_points(model, motion, seen.layout, intrinsics[seen.id])
        for seen, motion in zip(keypoints.videos, answer.motions, strict=True)
    }
    xy_first_px = {c.id: c.xy_first_px for c in camera_motion.videos}
    return score(answer, keypoints, truth, points, xy_first_px)


def shots_of(
    ctx: Context,
    keypoints: Keypoints,
    camera_motion: CameraMotion,
    answers: list[StageResult],
    model: Model,
) -> list[SheetVideo]:
    """Each video with its first and its last answer."""
    first, last = answers[0], answers[-1]
    return [
        SheetVideo(
            seen, camera, ctx.video(seen.id), model.points(seen.layout).names, a, b, solved.K
        )
        for seen, camera, a, b, solved in zip(
            keypoints.videos,
            camera_motion.videos,
            first.motions,
            last.motions,
            last.cameras or [],
            strict=True,
        )
    ]


def lead_of(refined: RefineSync) -> str:
    """One sentence under the report's title."""
    count = len(refined.sync.ids)
    videos = "1 video" if count == 1 else f"{count} videos, reference {refined.sync.reference}"
    return f"{videos}. The loop: {refined.status}."


if __name__ == "__main__":
    raise SystemExit(stage_main("evaluate"))

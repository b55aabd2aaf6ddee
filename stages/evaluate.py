"""evaluate: every result against the truth, where there is one, and the report's folder."""

from __future__ import annotations

from imocap_core.artifacts.schemas import (
    CameraMotion,
    Evaluate,
    Hands,
    InitialSmpl,
    Keypoints,
    Redetect,
    RefineSync,
    SmplBa,
    Sync,
    Uncertainty,
)
from imocap_core.body import load_free_body
from imocap_core.cli import stage_main
from imocap_core.evaluate.action_scores import score_action, score_results
from imocap_core.evaluate.scoreboard import action_truth, stage_results, true_positions
from imocap_core.figures.sheets import sheet_videos
from imocap_core.params import Params
from imocap_core.pipeline.stage import Context, Inputs
from imocap_core.report.evaluation import (
    all_scores_table,
    draw_contact_sheets,
    draw_plots,
    evaluation_tables,
)
from imocap_core.report.table_files import Picture, write_report
from imocap_core.report.uncertainty_tables import write_observability


def run(ctx: Context, inputs: Inputs, params: Params) -> Evaluate:
    """Score the monocular start, the single pass and the loop; write tables and figures."""
    keypoints, camera_motion = inputs.get(Keypoints), inputs.get(CameraMotion)
    initial, sync, refined = inputs.get(InitialSmpl), inputs.get(Sync), inputs.get(RefineSync)
    claimed, hands = inputs.get(Uncertainty), inputs.get(Hands)
    folder = ctx.action_file().parent
    truth = action_truth(folder, ctx.truth(), keypoints)
    model = load_free_body(ctx.device)

    ctx.progress(0.1, "scoring")
    results = stage_results(initial, sync, inputs.get(SmplBa), refined, camera_motion)
    rows = score_results(results, keypoints, camera_motion, truth, model)
    scores = score_action(rows, results, keypoints, sync, refined, claimed, hands, truth)
    tables = evaluation_tables(
        scores, keypoints, camera_motion, initial, refined, claimed, inputs.get(Redetect), truth
    )

    pictures: list[Picture] = []
    if params.evaluate.figures:
        drawn = load_free_body()  # pictures are drawn by NumPy
        ctx.progress(0.3, "drawing plots")
        positions = true_positions(refined.sync, truth)
        pictures += draw_plots(ctx.report, sync, refined, results, truth, positions, scores.rounds)
        ctx.progress(0.6, "drawing over the videos")
        files = {video.id: ctx.video(video.id) for video in keypoints.videos}
        videos = sheet_videos(keypoints, camera_motion, initial, refined, files, drawn)
        pictures += draw_contact_sheets(ctx.report, videos, refined, drawn)

    every = all_scores_table(scores)
    written = write_report(ctx.report, folder.name, tables, every, pictures)
    written.append(write_observability(ctx.report, folder.name, claimed, refined.sync))
    return Evaluate(tables=[*tables, every], files=sorted(written))


if __name__ == "__main__":
    raise SystemExit(stage_main("evaluate"))

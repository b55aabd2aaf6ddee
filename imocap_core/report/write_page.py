"""Artifacts to the report's last figures and its page; imported only when one is to be made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from imocap_core.artifacts.schemas import (
    CameraMotion,
    Evaluate,
    InitialSmpl,
    Keypoints,
    RefineSync,
    SmplBa,
    Uncertainty,
)
from imocap_core.artifacts.store import Stored
from imocap_core.body import Model, load_free_body
from imocap_core.figures.contact_sheets import SheetVideo
from imocap_core.figures.results_sheet import SheetResult
from imocap_core.pipeline.runner import Job
from imocap_core.pipeline.timings import timing_table
from imocap_core.report.files import read_contents
from imocap_core.report.page import html_page, markdown_page
from imocap_core.report.page_figures import draw_page_figures
from imocap_core.report.page_files import PAGE, TEXT
from imocap_core.report.sections import sections
from imocap_core.workspace import video_files


def write_page(
    job: Job,
    folder: Path,
    stored: Mapping[str, Stored],
    single: Stored | None,
    seconds: Mapping[str, float | None],
    beside: Sequence[str],
    stamp: str,
) -> None:
    """Draw what `evaluate` has not drawn and write the page, as HTML and as Markdown.

    single: smpl_ba's result with one motion for all videos. seconds: of each stage. beside: files
    in the folder that the page leads to.
    """
    keypoints = stored["keypoints"].decode(Keypoints)
    measured = stored["evaluate"].decode(Evaluate)
    model = load_free_body()
    tables = {table.name: table for table in measured.tables}
    pictures = draw_page_figures(
        folder,
        shots_of(job, stored, model),
        results_of(stored, single),
        keypoints,
        stored["refine_sync"].decode(RefineSync),
        stored["uncertainty"].decode(Uncertainty),
        tables.get("uncertainty_joints"),
        model,
    )
    contents = read_contents(folder)
    frames = sum(len(video.frames) for video in keypoints.videos)
    every = [*measured.tables, timing_table(seconds, frames)]
    parts = sections(every, [*contents.pictures, *pictures])
    (folder / TEXT).write_text(markdown_page(contents, parts), encoding="utf-8", newline="\n")
    page = html_page(folder, contents, parts, beside, stamp)
    (folder / PAGE).write_text(page, encoding="utf-8", newline="\n")


def shots_of(job: Job, stored: Mapping[str, Stored], model: Model) -> list[SheetVideo]:
    """Each video with its monocular fit and its final motion."""
    files = video_files(job.action)
    last = stored["refine_sync"].decode(RefineSync).motion
    return [
        SheetVideo(seen, camera, files[seen.id], model.points(seen.layout).names, a, b, solved.K)
        for seen, camera, a, b, solved in zip(
            stored["keypoints"].decode(Keypoints).videos,
            stored["camera_motion"].decode(CameraMotion).videos,
            stored["initial_smpl"].decode(InitialSmpl).videos,
            last.videos,
            last.cameras,
            strict=True,
        )
    ]


def results_of(stored: Mapping[str, Stored], single: Stored | None) -> list[SheetResult]:
    """The answers that are held side by side, in the order in which they come about."""
    alone = stored["camera_motion"].decode(CameraMotion).videos
    initial = stored["initial_smpl"].decode(InitialSmpl).videos
    results = [SheetResult("initial\n(monocular)", initial, {c.id: c.K for c in alone})]
    solved = {"all videos,\nsingle pass": stored["smpl_ba"].decode(SmplBa)}
    if single is not None:
        solved = {"single model\n(one motion)": single.decode(SmplBa), **solved}
    solved["all videos,\nafter the loop"] = stored["refine_sync"].decode(RefineSync).motion
    for name, found in solved.items():
        results.append(SheetResult(name, found.videos, {c.id: c.K for c in found.cameras}))
    return results

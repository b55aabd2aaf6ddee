"""Stored results to the page and its figures; imported only when a page is written."""

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
from imocap_core.figures.contact_sheets import SheetVideo, sheet_videos
from imocap_core.figures.results_sheet import SheetResult
from imocap_core.made_files import record_made
from imocap_core.pipeline.runner import Job
from imocap_core.pipeline.timings import timing_table
from imocap_core.report.files import read_contents
from imocap_core.report.page import html_page, markdown_page
from imocap_core.report.page_figures import draw_page_figures
from imocap_core.report.page_files import PAGE, TEXT
from imocap_core.report.sections import sections
from imocap_core.result.artifacts import artifacts_of_stages
from imocap_core.result.verdict import verdict_of_artifacts
from imocap_core.verdict.verdict_file import FILE, verdict_text
from imocap_core.whole_files import write_whole
from imocap_core.workspace import video_files


def write_page(
    job: Job,
    folder: Path,
    stored: Mapping[str, Stored],
    single: Stored | None,
    seconds: Mapping[str, float | None],
    beside: Sequence[str],
    stamp: str,
    sources: str,
) -> None:
    """Draw the page's figures and write the page, as HTML and as Markdown, and the verdict.

    Args:
        single: smpl_ba's result with one motion for all videos. seconds: of each stage. beside:
            files in the folder that the page links to. stamp: see `action_report`.
        sources: which video is which file.
    """
    keypoints = stored["keypoints"].decode(Keypoints)
    evaluated = stored["evaluate"].decode(Evaluate)
    model = load_free_body()
    tables = {table.name: table for table in evaluated.tables}
    pictures = draw_page_figures(
        folder,
        sheet_videos_of(job, stored, model),
        sheet_results_of(stored, single),
        keypoints,
        stored["refine_sync"].decode(RefineSync),
        stored["uncertainty"].decode(Uncertainty),
        tables.get("uncertainty_joints"),
        model,
    )
    contents = read_contents(folder)
    frames = sum(len(video.frames) for video in keypoints.videos)
    every = [*evaluated.tables, timing_table(seconds, frames)]
    parts = sections(every, [*contents.pictures, *pictures], len(keypoints.videos))
    verdict = verdict_of_artifacts(artifacts_of_stages(job.action.name, stored))
    assert verdict is not None
    files = {
        FILE: verdict_text(verdict),
        TEXT: markdown_page(contents, verdict, parts, sources),
        PAGE: html_page(folder, contents, verdict, parts, beside, stamp, sources),
    }
    for name, text in files.items():
        write_whole(folder / name, text)
    record_made(folder, [*files, *(picture.file for picture in pictures)])


def sheet_videos_of(job: Job, stored: Mapping[str, Stored], model: Model) -> list[SheetVideo]:
    """Each video with its monocular and its final motion."""
    return sheet_videos(
        stored["keypoints"].decode(Keypoints),
        stored["camera_motion"].decode(CameraMotion),
        stored["initial_smpl"].decode(InitialSmpl),
        stored["refine_sync"].decode(RefineSync),
        video_files(job.action),
        model,
    )


def sheet_results_of(stored: Mapping[str, Stored], single: Stored | None) -> list[SheetResult]:
    """The results that are shown side by side, in the order of the stages."""
    cameras = stored["camera_motion"].decode(CameraMotion).videos
    initial = stored["initial_smpl"].decode(InitialSmpl).videos
    results = [SheetResult("initial\n(monocular)", initial, {c.id: c.K for c in cameras})]
    if len(initial) == 1:
        return results  # there is nothing to compare
    solved = {"all videos,\nsingle pass": stored["smpl_ba"].decode(SmplBa)}
    if single is not None:
        solved = {"single model\n(one motion)": single.decode(SmplBa), **solved}
    solved["all videos,\nafter the loop"] = stored["refine_sync"].decode(RefineSync).motion
    for name, result in solved.items():
        results.append(SheetResult(name, result.videos, {c.id: c.K for c in result.cameras}))
    return results

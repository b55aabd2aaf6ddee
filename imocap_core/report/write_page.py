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
    Table,
    Uncertainty,
)
from imocap_core.artifacts.store import Stored
from imocap_core.body import Model, load_free_body
from imocap_core.diagnostics.findings import FILE, verdict_text
from imocap_core.figures.overlays import Image, Window
from imocap_core.figures.page_figures import uncertainty_figure
from imocap_core.figures.sheets import (
    SheetResult,
    SheetVideo,
    picks_of,
    read_cells,
    results_sheet,
    sheet_videos,
)
from imocap_core.figures.style import quiet, save
from imocap_core.files import record_made, write_whole
from imocap_core.pipeline.runner import Job
from imocap_core.report.first_page import ANGLES, CARD, card_page, first_page, last_result
from imocap_core.report.page import html_page, sections
from imocap_core.report.page_files import PAGE, links
from imocap_core.report.table_files import Picture, read_contents
from imocap_core.result.artifacts import artifacts_of_stages, verdict_of_artifacts
from imocap_core.result.read import read_result
from imocap_core.result.result import ActionResult
from imocap_core.workers import thread_map
from imocap_core.workspace import video_files

_RESULTS, _UNCERTAINTY = "results.webp", "uncertainty.png"


def draw_page_figures(
    folder: Path,
    videos: Sequence[SheetVideo],
    results: Sequence[SheetResult],
    keypoints: Keypoints,
    refined: RefineSync,
    claimed: Uncertainty,
    by_joint: Table | None,
    model: Model,
) -> list[Picture]:
    """The same frames under each of `results`; the uncertainty of each joint.

    by_joint: the table `uncertainty_joints`, which has the true errors.
    """
    picks = picks_of(videos)
    shown = [sorted(t for w, t in picks if w == v) for v in range(len(videos))]
    read = [(video, frames) for video, frames in zip(videos, shown, strict=True) if frames]
    of_videos = thread_map(lambda item: read_cells(item[0].keypoints, item[0].file, item[1]), read)
    ids = [video.keypoints.id for video, _ in read]
    cells: dict[str, dict[int, Image]] = dict(zip(ids, (c for c, _ in of_videos), strict=True))
    cuts: dict[str, dict[int, Window]] = dict(zip(ids, (w for _, w in of_videos), strict=True))
    drawn = []
    with quiet():
        save(results_sheet(videos, results, picks, cells, cuts, model), folder / _RESULTS)
        caption = "Where the results differ most: the body over the frame, and from the side."
        drawn.append(Picture(_RESULTS, caption))
        save(uncertainty_figure(claimed, keypoints, refined.sync, by_joint), folder / _UNCERTAINTY)
        drawn.append(Picture(_UNCERTAINTY, "Uncertainty of each joint, overall and over time."))
    return drawn


def write_page(
    job: Job, folder: Path, stored: Mapping[str, Stored], stamp: str, sources: str
) -> None:
    """Draw the page's figures and write the page, and the verdict.

    Args:
        stamp: see `action_report`. sources: which video is which file.
    """
    keypoints = stored["keypoints"].decode(Keypoints)
    evaluated = stored["evaluate"].decode(Evaluate)
    model = load_free_body()
    tables = {table.name: table for table in evaluated.tables}
    videos, refined = _sheet_videos_of(job, stored, model), stored["refine_sync"].decode(RefineSync)
    pictures = draw_page_figures(
        folder,
        videos,
        _sheet_results_of(stored),
        keypoints,
        refined,
        stored["uncertainty"].decode(Uncertainty),
        tables.get("uncertainty_joints"),
        model,
    )
    contents = read_contents(folder)
    parts = sections(evaluated.tables, [*contents.pictures, *pictures], len(keypoints.videos))
    artifacts = artifacts_of_stages(job.action.name, stored)
    verdict = verdict_of_artifacts(artifacts)
    assert verdict is not None
    with quiet():
        before = last_result(job, stored)
        first = first_page(read_result(artifacts, ActionResult), before)
        if first is not None:
            save(first.figure, folder / ANGLES)
    differences = () if first is None else first.differences
    card = card_page(contents.title, verdict, differences, videos, refined, model)
    if card is None:
        (folder / CARD).unlink(missing_ok=True)
    else:
        write_whole(folder / CARD, card)
    pages = links(folder.parent, job.action.name)
    files = {
        FILE: verdict_text(verdict),
        PAGE: html_page(folder, contents, verdict, parts, pages, stamp, sources, first),
    }
    for name, text in files.items():
        write_whole(folder / name, text)
    drawn = [*(picture.file for picture in pictures), *([ANGLES] if first else [])]
    record_made(folder, [*files, *drawn, *([CARD] if card else [])])


def _sheet_videos_of(job: Job, stored: Mapping[str, Stored], model: Model) -> list[SheetVideo]:
    """Each video with its monocular and its final motion."""
    return sheet_videos(
        stored["keypoints"].decode(Keypoints),
        stored["camera_motion"].decode(CameraMotion),
        stored["initial_smpl"].decode(InitialSmpl),
        stored["refine_sync"].decode(RefineSync),
        video_files(job.action),
        model,
    )


def _sheet_results_of(stored: Mapping[str, Stored]) -> list[SheetResult]:
    """The results that are shown side by side, in the order of the stages."""
    cameras = stored["camera_motion"].decode(CameraMotion).videos
    initial = stored["initial_smpl"].decode(InitialSmpl).videos
    results = [SheetResult("initial\n(monocular)", initial, {c.id: c.K for c in cameras})]
    if len(initial) == 1:
        return results  # there is nothing to compare
    solved = {
        "all videos,\nsingle pass": stored["smpl_ba"].decode(SmplBa),
        "all videos,\nafter the loop": stored["refine_sync"].decode(RefineSync).motion,
    }
    for name, result in solved.items():
        results.append(SheetResult(name, result.videos, {c.id: c.K for c in result.cameras}))
    return results

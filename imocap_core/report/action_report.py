"""The page of an action, made of its artifacts when a run has brought them up to date."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from imocap_core.artifacts.store import Stored
from imocap_core.errors import ArtifactCorrupt, WorkFailed
from imocap_core.pipeline.graph import settings
from imocap_core.pipeline.runner import Job, Outcome
from imocap_core.pipeline.source import PROJECT, closure
from imocap_core.pipeline.timings import record, seconds_of
from imocap_core.report.page_files import PAGE, TEXT

MADE_BY = ("page_figures.py", "page.py")
BESIDE = ("viewer.html", "compare/report.md", "observability.md")
NEEDED = {
    "keypoints": "Keypoints",
    "camera_motion": "CameraMotion",
    "initial_smpl": "InitialSmpl",
    "sync": "Sync",
    "smpl_ba": "SmplBa",
    "refine_sync": "RefineSync",
    "uncertainty": "Uncertainty",
    "evaluate": "Evaluate",
}
SINGLE = "motion.objective=single"


def finish(job: Job, outcomes: Sequence[Outcome]) -> Path | None:
    """Note how long the stages took, and make the page where it is not that of these results.

    None when the run did not get as far as a report. WorkFailed when it can't be made.
    """
    record(job.store, job.action.name, outcomes)
    stored = {outcome.stage: outcome.stored for outcome in outcomes}
    if not complete(stored):
        return None
    return bring_up_to_date(job, stored)


def complete(stored: Mapping[str, Stored]) -> bool:
    """Whether these are the results that a report is made of."""
    return all(stage in stored and stored[stage].schema == s for stage, s in NEEDED.items())


def bring_up_to_date(job: Job, stored: Mapping[str, Stored]) -> Path:
    """The page of these results, made again only where something has changed."""
    folder = job.store.report(job.action.name)
    page = folder / PAGE
    seconds = seconds_of(job.store, job.action.name, {s: r.digest for s, r in stored.items()})
    single = single_model(job, stored)
    beside = [name for name in BESIDE if (folder / name).is_file()]
    stamp = _stamp(stored, seconds, beside, single)
    if (folder / TEXT).is_file() and page.is_file() and stamp in _head(page):
        return page
    from imocap_core.report.write_page import write_page

    try:
        write_page(job, folder, stored, single, seconds, beside, stamp)
    except ArtifactCorrupt as error:
        said = str(error).splitlines()[0]
        raise WorkFailed(f"report: {said}; run the action again") from None
    except OSError as error:
        raise WorkFailed(f"report: cannot use {error.filename}: {error.strerror}") from None
    except ValueError as error:
        raise WorkFailed(f"report: {error}") from None
    return page


def single_model(job: Job, stored: Mapping[str, Stored]) -> Stored | None:
    """smpl_ba's result with one motion for all videos, where it has been made some time."""
    chosen = settings(job.pipeline, job.action.params, job.action.file, [SINGLE])
    alike = Job(job.pipeline, job.store, job.action, chosen)
    key = alike.recipe("smpl_ba", stored).key
    found = job.store.find(job.action.name, "smpl_ba", key)
    same = found is not None and found.digest == stored["smpl_ba"].digest
    return None if same else found


def _stamp(
    stored: Mapping[str, Stored],
    seconds: Mapping[str, float | None],
    beside: Sequence[str],
    single: Stored | None,
) -> str:
    """A digest of all that the page is made of."""
    views = PROJECT / "imocap_core" / "report"
    code = {name: digest for file in MADE_BY for name, digest in closure(views / file).items()}
    results = {stage: stored[stage].digest for stage in NEEDED}
    said = [results, code, dict(seconds), list(beside), None if single is None else single.digest]
    return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()


def _head(page: Path) -> str:
    """The page's beginning, where its stamp is."""
    with page.open(encoding="utf-8") as stream:
        return stream.read(400)

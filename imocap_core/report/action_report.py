"""The report of a run: its page is written when the run's results differ from those it shows."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePath

from imocap_core.artifacts.file_memory import save_memory
from imocap_core.artifacts.store import Stored
from imocap_core.diagnostics.findings import FILE, Verdict, read_verdict
from imocap_core.errors import ArtifactCorrupt, WorkFailed, system_fault
from imocap_core.files import is_as_made, is_whole_page
from imocap_core.pipeline.runner import Job, Outcome
from imocap_core.pipeline.source import PROJECT, closure
from imocap_core.report.page_files import PAGE, refresh_pages

_MADE_BY = ("report/write_page.py", "report/page.py", "diagnostics/action_verdict.py")
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


def finish(job: Job, outcomes: Sequence[Outcome]) -> Path | None:
    """Write the page unless it shows these results already.

    Returns the page, or None when the run has no complete results. WorkFailed when the page cannot
    be written.
    """
    stored = {outcome.stage: outcome.stored for outcome in outcomes}
    if not complete(stored):
        return None
    page = bring_up_to_date(job, stored)
    refresh_pages(job.store, job.action.name)
    save_memory(job.store.folder)
    return page


def verdict_of_run(job: Job, outcomes: Sequence[Outcome]) -> Verdict | None:
    """The verdict on a run's results; None where the motion of all videos is not among them.

    Read from the report's folder where the report is of these results.
    """
    stored = {outcome.stage: outcome.stored for outcome in outcomes}
    if "refine_sync" not in stored or stored["refine_sync"].schema != NEEDED["refine_sync"]:
        return None
    folder = job.store.report(job.action.name)
    if complete(stored) and is_as_made(folder, FILE):
        try:
            return read_verdict((folder / FILE).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            pass  # written by an older program, or removed
    from imocap_core.result.artifacts import artifacts_of_stages, verdict_of_artifacts

    return verdict_of_artifacts(artifacts_of_stages(job.action.name, stored))


def complete(stored: Mapping[str, Stored]) -> bool:
    """Whether all results of a report are there."""
    return all(stage in stored and stored[stage].schema == s for stage, s in NEEDED.items())


def bring_up_to_date(job: Job, stored: Mapping[str, Stored]) -> Path:
    """The page of these results, written only when something has changed."""
    folder = job.store.report(job.action.name)
    page = folder / PAGE
    names = {v.id: PurePath(v.video).name for v in job.action.videos if v.video is not None}
    sources = "Files: " + ", ".join(f"{i} is {n}" for i, n in names.items()) + "." if names else ""
    stamp = _stamp(stored, sources)
    there = all((folder / name).is_file() for name in (PAGE, FILE))
    if there and is_whole_page(page):
        with page.open(encoding="utf-8") as stream:
            if stamp in stream.read(400):  # in the head
                return page
    from imocap_core.report.write_page import write_page

    try:
        write_page(job, folder, stored, stamp, sources)
    except ArtifactCorrupt as error:
        reason = str(error).splitlines()[0]
        raise WorkFailed(f"report: {reason}; run the action again") from None
    except OSError as error:
        raise WorkFailed(f"report: {system_fault(error)}") from None
    except ValueError as error:
        raise WorkFailed(f"report: {error}") from None
    return page


def _stamp(stored: Mapping[str, Stored], sources: str) -> str:
    """A digest of everything that the page shows, and of the code that draws it."""
    core = PROJECT / "imocap_core"
    code = {name: digest for file in _MADE_BY for name, digest in closure(core / file).items()}
    results = {stage: stored[stage].digest for stage in NEEDED}
    content = [results, code, sources]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

"""Where the report of an action is."""

from __future__ import annotations

from pathlib import Path

from imocap_core.pipeline.runner import Job


def report_page(job: Job) -> Path | None:
    """The page of an action's report to open first; the folder itself when it has none."""
    folder = job.store.report(job.action.name)
    for name in ("report.html", "index.html", "report.md", "index.md"):
        if (folder / name).is_file():
            return folder / name
    return folder if folder.is_dir() else None

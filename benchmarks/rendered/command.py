"""benchmark rendered: measure, and say where the report is."""

from __future__ import annotations

from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace


def rendered_report(
    workspace: Workspace,
    videos: int,
    small: bool,
    only: tuple[str, ...],
    jobs: int,
    docs: bool,
    display: Display,
) -> list[str]:
    """The tables as Markdown, and what was written."""
    from benchmarks.docs import check_marks, put_into_docs
    from benchmarks.rendered.measure import Rendering, measure

    choice = Rendering(videos, small, only)
    if docs:
        check_marks(workspace.root, choice.label)
    text, folder = measure(workspace, choice, display, jobs)
    said = [text, f"Kept in {folder}"]
    if docs:
        files = put_into_docs(workspace.root, choice.label, text, text)
        said += [f"Put into {file}" for file in files]
    return said

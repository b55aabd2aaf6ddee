"""The undisturbed actions of the benchmark, and whether they can be run on this machine."""

from __future__ import annotations

from pathlib import Path

from benchmarks.actions.captured import data_folder
from benchmarks.actions.choice import Choice
from benchmarks.actions.prepare import existing_job, ready_job
from benchmarks.parallel import ActionDisplay
from benchmarks.rendered.jobs import RenderedChoice, existing_rendered, ready_rendered
from benchmarks.rendered.names import RENDERED, check_detector, is_rendered, trial_of
from benchmarks.stability.perturbations import OF_FILES, OF_PIXELS, Perturbation
from imocap_core.errors import WorkFailed
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace

REAL, DEMO, TRIALS = "balance_beam", "yoga", ("cmu_walk_s07", "tennis_serve_jarua")
PIXELS = "-pixels"
FILMS = ("cmu_walk_s07", "cmu_forward_jump_s13", "tennis_serve_jarua")
ACTIONS = (REAL, REAL + PIXELS, DEMO, DEMO + PIXELS, *TRIALS, *(f + RENDERED for f in FILMS))


def is_detected(name: str) -> bool:
    """Whether an action of the benchmark starts from pixels."""
    return name.endswith(PIXELS) or is_rendered(name)


def perturbations_of(name: str) -> tuple[Perturbation, ...]:
    """What an action is put through; the first is the action as it is."""
    return OF_PIXELS if is_detected(name) else OF_FILES


def existing_source(workspace: Workspace, name: str) -> Path | None:
    """The folder of an undisturbed action, nothing made; None when there is none."""
    base = name.removesuffix(PIXELS)
    if base == REAL:
        try:
            return data_folder(workspace.root, REAL)
        except WorkFailed:
            return None
    if base == DEMO:
        folder = workspace.root / "actions" / DEMO
        return folder if folder.is_dir() else None
    try:
        if is_rendered(name):
            job = existing_rendered(workspace.root, RenderedChoice(), trial_of(name))
        else:
            job = existing_job(workspace, _trials(base), base, ())
    except WorkFailed:
        return None
    return None if job is None else job.action.folder


def ready_source(workspace: Workspace, name: str, display: Display) -> Path:
    """The folder of an undisturbed action, made first where the project makes it.

    WorkFailed with the reason when its data or the detector's environment are not here.
    """
    if is_detected(name):
        check_detector(workspace.root)
    base = name.removesuffix(PIXELS)
    if base == REAL:
        return data_folder(workspace.root, REAL)
    if is_rendered(name):
        shown = ActionDisplay(display, name)
        job = ready_rendered(workspace.root, RenderedChoice(), trial_of(name), shown)
        return job.action.folder
    choice = Choice(DEMO) if base == DEMO else _trials(base)
    return ready_job(workspace, choice, base, (), display).action.folder


def _trials(name: str) -> Choice:
    return Choice("trials", only=(name,))

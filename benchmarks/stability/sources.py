"""The undisturbed actions of the benchmark, and whether they can be run on this machine."""

from __future__ import annotations

from pathlib import Path

from benchmarks.actions.captured import data_folder
from benchmarks.actions.choice import Choice
from benchmarks.actions.prepare import existing_job, ready_job
from benchmarks.stability.perturbations import OF_FILES, OF_PIXELS, Perturbation
from imocap_core.detect.setup import is_set_up
from imocap_core.errors import WorkFailed
from imocap_core.params import DetectParams
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace

REAL, DEMO, TRIALS = "balance_beam", "yoga", ("cmu_walk_s07", "tennis_serve_jarua")
PIXELS = "-pixels"
ACTIONS = (REAL, REAL + PIXELS, DEMO, DEMO + PIXELS, *TRIALS)


def is_detected(name: str) -> bool:
    """Whether an action of the benchmark starts from pixels."""
    return name.endswith(PIXELS)


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
        job = existing_job(workspace, _trials(base), base, ())
    except WorkFailed:
        return None
    return None if job is None else job.action.folder


def ready_source(workspace: Workspace, name: str, display: Display) -> Path:
    """The folder of an undisturbed action, made first where the project makes it.

    WorkFailed with the reason when its data or the detector's environment are not here.
    """
    if is_detected(name):
        _check_detector(workspace.root)
    base = name.removesuffix(PIXELS)
    if base == REAL:
        return data_folder(workspace.root, REAL)
    choice = Choice(DEMO) if base == DEMO else _trials(base)
    return ready_job(workspace, choice, base, (), display).action.folder


def _trials(name: str) -> Choice:
    return Choice("trials", only=(name,))


def _check_detector(root: Path) -> None:
    from imocap_core.detect.detectors import detector_of

    if not is_set_up(detector_of(DetectParams(), root)):
        raise WorkFailed("the detector's environment is not installed (`imocap detect --setup`)")

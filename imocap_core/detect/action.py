"""The videos of an action that say `keypoints: detect`: which are done, and the others' turn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from imocap_core.artifacts.store import Store
from imocap_core.detect.detection import detect_video, kept_at
from imocap_core.detect.detectors import Detector, detector_of
from imocap_core.detect.environment import python_for
from imocap_core.errors import WorkFailed
from imocap_core.io.video import probe
from imocap_core.params import DetectParams
from imocap_core.pipeline.action import DETECT, Action, Declaration

if TYPE_CHECKING:
    from imocap_core.pipeline.runner import Display


def with_detections(action: Action, params: DetectParams, store: Store) -> Action:
    """The action as the stages see it: what was detected stands as if somebody had brought it."""
    detector = detector_of(params, action.folder)
    files = {v.id: _file(action, v, detector, store) for v in action.videos if v.detected}
    return replace(
        action,
        videos=tuple(_declared(v, detector) if v.detected else v for v in action.videos),
        detected={video: file for video, file in files.items() if file and file.is_file()},
    )


def detect(action: Action, params: DetectParams, store: Store, display: Display) -> None:
    """Run the detector on every video that has not been through it.

    Results are kept video by video: what was finished before a break is not done again.
    WorkFailed says in a sentence why it cannot be done.
    """
    detector = detector_of(params, action.folder)
    missing = [str(model) for model in detector.models if not model.is_file()]
    if missing:
        raise WorkFailed(f"{action.file}: params.detect: there is no {missing[0]}")
    waiting = [v for v in action.videos if v.detected and v.id not in action.detected]
    if not waiting:
        return
    _must_be_readable(action, waiting)
    display.started("detect", [f"{detector.version} has not seen {waiting[0].id}"])
    root = store.folder.parent
    python = python_for(detector.packages, root, lambda what: display.progress(0.0, what))
    for number, declared in enumerate(waiting):
        if number:
            display.started("detect", [f"{detector.version} has not seen {declared.id}"])
        file = _file(action, declared, detector, store)
        assert file is not None
        assert declared.video is not None
        if file.is_file():  # the same pictures under another name
            continue
        try:
            detect_video(action.folder / declared.video, file, detector, python, display.progress)
        except ValueError as error:  # broken further on
            raise WorkFailed(f"detect: {error}") from error


def _must_be_readable(action: Action, waiting: list[Declaration]) -> None:
    """WorkFailed, before anything takes time, for a file that is no video."""
    try:
        for declared in waiting:
            probe(action.folder / str(declared.video))
    except ValueError as error:
        raise WorkFailed(f"{action.file}: {error}") from None


def _file(action: Action, declared: Declaration, detector: Detector, store: Store) -> Path | None:
    """Where a video's detections lie; None when there is no such video (or model) to ask about."""
    assert declared.video is not None
    video = action.folder / declared.video
    there = all(path.is_file() for path in (video, *detector.models))
    return kept_at(store, video, detector) if there else None


def _declared(declared: Declaration, detector: Detector) -> Declaration:
    """What action.yaml would say of the file."""
    said: dict[str, str | None] = {"format": detector.format, "layout": detector.layout}
    if declared.initial in (None, DETECT):
        own = detector.initial_format
        said |= {"initial": DETECT if own else None, "initial_format": own}
    return declared.model_copy(update=said)

"""Detection for the videos of an action that declare `keypoints: detect`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from imocap_core.artifacts.store import Store
from imocap_core.detect.detection import detect_video, detections_file
from imocap_core.detect.detectors import Detector, detector_of
from imocap_core.detect.setup import set_up
from imocap_core.errors import WorkFailed
from imocap_core.io.video import probe
from imocap_core.params import DetectParams
from imocap_core.pipeline.action import DETECT, Action, Declaration

if TYPE_CHECKING:
    from imocap_core.pipeline.runner import Display


def with_detections(action: Action, params: DetectParams, store: Store) -> Action:
    """The action for the stages: detected keypoints are declared as if they had been given."""
    detector = detector_of(params, action.folder)
    files = {v.id: _file(action, v, detector, store) for v in action.videos if v.detected}
    return replace(
        action,
        videos=tuple(_declared(v, detector) if v.detected else v for v in action.videos),
        detected={video: file for video, file in files.items() if file and file.is_file()},
    )


def detect(action: Action, params: DetectParams, store: Store, display: Display) -> None:
    """Run the detector on every video that has no detections yet.

    Detections are stored video by video, so an interrupted run goes on where it stopped.
    WorkFailed when a model is missing, a video cannot be read, or the detector fails.
    """
    detector = detector_of(params, action.folder)
    missing = [str(model) for model in detector.models if not model.is_file()]
    if missing:
        raise WorkFailed(f"{action.file}: params.detect: {missing[0]} does not exist")
    waiting = [v for v in action.videos if v.detected and v.id not in action.detected]
    if not waiting:
        return
    _must_be_readable(action, waiting)
    display.started("detect", [f"{waiting[0].id} has no detections of {detector.version}"])
    python = set_up(detector, lambda what: display.progress(0.0, what))
    for number, declared in enumerate(waiting):
        if number:
            display.started("detect", [f"{declared.id} has no detections of {detector.version}"])
        file = _file(action, declared, detector, store)
        assert file is not None
        assert declared.video is not None
        if file.is_file():  # the same video under another name
            continue
        try:
            detect_video(action.folder / declared.video, file, detector, python, display.progress)
        except ValueError as error:  # the video breaks off
            raise WorkFailed(f"detect: {error}") from error


def _must_be_readable(action: Action, waiting: list[Declaration]) -> None:
    """WorkFailed, before anything takes time, for a file that is no video."""
    try:
        for declared in waiting:
            probe(action.folder / str(declared.video))
    except ValueError as error:
        raise WorkFailed(f"{action.file}: {error}") from None


def _file(action: Action, declared: Declaration, detector: Detector, store: Store) -> Path | None:
    """The file of a video's detections; None when the video or a model does not exist."""
    assert declared.video is not None
    video = action.folder / declared.video
    exist = all(path.is_file() for path in (video, *detector.models))
    return detections_file(store, video, detector) if exist else None


def _declared(declared: Declaration, detector: Detector) -> Declaration:
    """The declaration of the detections' file, as it would stand in action.yaml."""
    update: dict[str, str | None] = {"format": detector.format, "layout": detector.layout}
    if declared.initial in (None, DETECT):
        initial_format = detector.initial_format
        update |= {
            "initial": DETECT if initial_format else None,
            "initial_format": initial_format,
        }
    return declared.model_copy(update=update)

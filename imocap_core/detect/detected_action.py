"""Detection for the videos of an action that declare `keypoints: detect`."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from imocap_core.adapters.tracked_people import LEAST_VIDEOS
from imocap_core.artifacts.store import Store
from imocap_core.detect.detection import detect_video, detect_videos, detections_file, set_up
from imocap_core.detect.detectors import Detector, detector_of
from imocap_core.errors import WorkFailed
from imocap_core.io.frame_access import check_video, decode_whole
from imocap_core.params import DetectParams
from imocap_core.pipeline.action import DETECT, Action, Declaration, path_of

if TYPE_CHECKING:
    from imocap_core.pipeline.runner import Display


def with_detections(action: Action, params: DetectParams, store: Store) -> Action:
    """The action for the stages: detected keypoints are declared as if they had been given."""
    detector = detector_of(params, action.folder)
    files = {v.id: _file(action, v, detector, store) for v in action.videos if v.detected}
    return replace(
        action,
        videos=tuple(_declared(v, detector) if v.detected else v for v in action.videos),
        detected={
            video: file for video, file in files.items() if file is not None and file.is_file()
        },
    )


def detect(action: Action, params: DetectParams, store: Store, display: Display) -> None:
    """Run the detector on every video that has no detections yet.

    Detections are stored video by video, so an interrupted run goes on where it stopped. A video
    that cannot be decoded to its end is passed over where others remain: the stage keypoints names
    it. WorkFailed when a model is missing, too few videos can be read, or the detector fails.
    """
    detector = detector_of(params, action.folder)
    missing = [str(model) for model in detector.models if not model.is_file()]
    if missing:
        raise WorkFailed(f"{action.file}: params.detect: {missing[0]} does not exist")
    undone = [v for v in action.videos if v.detected and v.id not in action.detected]
    look_through = len(undone) < len(action.videos)  # what a run before left out may be broken
    faults = {v.id: _fault(action, v, to_the_end=look_through) for v in undone}
    unreadable = [fault for fault in faults.values() if fault]
    _require_enough(action, unreadable)
    waiting = [v for v in undone if not faults[v.id]]
    if not waiting:
        return
    display.started("detect", [f"{v.id} has no detections of {detector.version}" for v in waiting])
    python = set_up(detector, display.notice)
    undetected: dict[Path, Path] = {}  # by file: one video may have several names
    for declared in waiting:
        file = _file(action, declared, detector, store)
        assert file is not None
        assert declared.video is not None
        undetected[file] = path_of(action.folder, declared.video)
    broken = detect_videos(undetected, detector, python, display.progress)
    _require_enough(action, [*unreadable, *(f"{action.file}: {error}" for error in broken)])


def detect_one(
    action: Action, video: str, params: DetectParams, store: Store, display: Display
) -> None:
    """Run the detector on one video of an action, unless it has been run.

    A video that cannot be decoded is passed over: the stage keypoints names it.
    """
    detector = detector_of(params, action.folder)
    declared = next(v for v in action.videos if v.id == video)
    file = _file(action, declared, detector, store)
    if file is None or file.is_file() or _fault(action, declared, to_the_end=bool(action.detected)):
        return
    display.started("detect", [f"{video} has no detections of {detector.version}"])
    python = set_up(detector, display.notice)
    with suppress(ValueError):
        detect_video(
            path_of(action.folder, str(declared.video)), file, detector, python, display.progress
        )


def _require_enough(action: Action, faults: Sequence[str]) -> None:
    """WorkFailed when fewer than two videos remain without those that cannot be read."""
    if faults and len(action.videos) - len(faults) < LEAST_VIDEOS:
        raise WorkFailed("\n".join(faults))


def _fault(action: Action, declared: Declaration, *, to_the_end: bool) -> str:
    """Why a video cannot be read; empty where it can. Whether it can be decoded to its end takes a
    second for some hundred pictures, where the detector would take ten to come to that."""
    video = path_of(action.folder, str(declared.video))
    try:
        check_video(video)
        if to_the_end:
            decode_whole(video)
    except ValueError as error:
        return f"{action.file}: {error}"
    return ""


def _file(action: Action, declared: Declaration, detector: Detector, store: Store) -> Path | None:
    """The file of a video's detections; None when the video or a model does not exist."""
    assert declared.video is not None
    video = path_of(action.folder, declared.video)
    exist = all(path.is_file() for path in (video, *detector.models))
    return detections_file(store, video, detector) if exist else None


def _declared(declared: Declaration, detector: Detector) -> Declaration:
    """The declaration of the detections' file, as it would stand in action.yaml."""
    update: dict[str, str | None] = {"format": detector.format, "layout": detector.layout}
    if declared.initial == DETECT:
        estimates = detector.format == "mediapipe"
        update |= {
            "initial": DETECT if estimates else None,
            "initial_format": "mediapipe_world" if estimates else None,
        }
    return declared.model_copy(update=update)

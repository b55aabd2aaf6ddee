"""Everybody who was tracked in the videos of an action, and how people are detected in them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from imocap_core.library.api_errors import Params, Progress, displaying, one_off, plain_errors
from imocap_core.workspace import Workspace

if TYPE_CHECKING:
    from imocap_core.detect.detectors import Detector


@dataclass(frozen=True)
class PersonSummary:
    """One person tracked in a video; action.yaml names it by `number`, or by box and frame.

    first_frame, last_frame: source frames. share: of the used frames in which it is tracked.
    score: by which the performer is chosen, over the best track's. box_px: x0 y0 x1 y1 in
    box_frame, the middle one of the track.
    """

    number: int
    first_frame: int
    last_frame: int
    share: float
    score: float
    box_px: tuple[float, float, float, float]
    box_frame: int


@dataclass(frozen=True)
class VideoPeople:
    """Everybody tracked in one video, best score first, and sentences about it.

    fault: why a run would leave the video out, and what to do; None when it can be used.
    """

    id: str
    tracks: list[PersonSummary]
    notes: list[str]
    fault: str | None = None


@plain_errors
def people(
    action: str | Path, *, root: str | Path = ".", params: Params = None, progress: Progress = None
) -> list[VideoPeople]:
    """Everybody who was tracked in an action's videos, and cuts between shots.

    WorkFailed where no video's detections can be read.
    """
    from imocap_core.library.tracked_people import people_of

    with displaying(progress) as display:
        job = Workspace(Path(root)).ready_job(str(action), one_off(params), display)
        return people_of(job.action, job.settings.params.keypoints)


@plain_errors
def detect(
    action: str | Path, *, root: str | Path = ".", params: Params = None, progress: Progress = None
) -> dict[str, Path]:
    """Detect people in the videos of an action that say `keypoints: detect`, and nothing more.

    Returns the files of keypoints, by video; a video that cannot be decoded has none
    (`not_detected`).
    """
    with displaying(progress) as display:
        job = Workspace(Path(root)).ready_job(str(action), one_off(params), display)
    return dict(job.action.detected)


@plain_errors
def not_detected(
    action: str | Path, *, root: str | Path = ".", params: Params = None
) -> dict[str, str]:
    """Why videos that say `keypoints: detect` have no detections, by video."""
    from imocap_core.io.frame_access import why_not_detected

    declared = Workspace(Path(root)).job(str(action), one_off(params)).action
    return {
        video.id: why_not_detected(declared.folder / str(video.video))
        for video in declared.videos
        if video.detected and video.id not in declared.detected
    }


@plain_errors
def set_up_detector(
    *, root: str | Path = ".", params: Params = None, progress: Progress = None
) -> tuple[str, Path]:
    """Make the environment of the detector in force; its name and version, and its Python."""
    from imocap_core.detect.detection import set_up

    detector = _detector(Workspace(Path(root)), params)
    with displaying(progress) as display:
        display.started("detect", [f"{detector.version} needs an environment of its own"])
        python = set_up(detector, display.notice)
    return detector.version, Path(python)


def detector_is_set_up(*, root: str | Path = ".", params: Params = None) -> bool:
    """Whether the detector in force needs nothing from the network."""
    from imocap_core.detect.detection import is_set_up

    return is_set_up(_detector(Workspace(Path(root)), params))


def _detector(workspace: Workspace, params: Params) -> Detector:
    from imocap_core.detect.detectors import detector_of
    from imocap_core.pipeline.graph import settings

    pipeline = workspace.pipeline()
    chosen = settings(pipeline, {}, pipeline.file, one_off(params)).params
    return detector_of(chosen.detect, workspace.root)

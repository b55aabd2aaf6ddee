"""Everybody who was tracked in the videos of an action, and how people are detected in them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from imocap_core.errors import WorkFailed
from imocap_core.library.api_errors import Params, Progress, displaying, one_off, plain_errors
from imocap_core.workspace import Workspace

if TYPE_CHECKING:
    from imocap_core.adapters.detected_people import DetectedVideo
    from imocap_core.adapters.tracked_people import TrackedVideo
    from imocap_core.detect.detectors import Detector
    from imocap_core.params import KeypointsParams
    from imocap_core.people.tracking import PersonTrack
    from imocap_core.pipeline.action import Action, Declaration


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
    with displaying(progress) as display:
        job = Workspace(Path(root)).ready_job(str(action), one_off(params), display)
        return people_of(job.action, job.settings.params.keypoints)


def people_of(action: Action, params: KeypointsParams) -> list[VideoPeople]:
    """Everybody in all videos, or why one is not used; WorkFailed where none can be read."""
    from imocap_core.adapters.tracked_people import declared_row

    faults: dict[str, str] = {}
    followed: dict[str, DetectedVideo] = {}
    for declared in action.videos:
        try:
            followed[declared.id] = _followed(action, declared, params)
            declared_row(followed[declared.id].people, action.file)
        except (ValueError, OSError) as error:
            faults[declared.id] = str(error)
    if not followed:
        raise WorkFailed("\n".join(faults.values()))
    notes = _performer_notes(followed, faults, action, params)
    for video in followed.values():
        notes[video.id] = [*notes.get(video.id, []), *video.remarks]
    ranked = {video.id: video.people.ranked for video in followed.values()}
    return [
        VideoPeople(
            id=declared.id,
            tracks=[
                _summary(number, score, track, followed[declared.id].people)
                for number, (score, track) in enumerate(ranked.get(declared.id, ()), start=1)
            ],
            notes=[note for note in notes.get(declared.id, []) if note],
            fault=faults.get(declared.id),
        )
        for declared in action.videos
    ]


def _performer_notes(
    followed: dict[str, DetectedVideo],
    faults: dict[str, str],
    action: Action,
    params: KeypointsParams,
) -> dict[str, list[str]]:
    """The performer's note by video, as a run would choose them; more faults come to `faults`."""
    from imocap_core.adapters.detected_people import performer_keypoints
    from imocap_core.adapters.tracked_people import choose_performers

    while True:
        usable = [video for video in followed.values() if video.id not in faults]
        performers = choose_performers([v.people for v in usable], action.file, params)
        before = len(faults)
        for video, performer in zip(usable, performers, strict=True):
            try:
                performer_keypoints(video, performer, params)
            except ValueError as error:
                faults[video.id] = str(error)
        if len(faults) == before:
            return {v.id: [p.note] for v, p in zip(usable, performers, strict=True)}


def _followed(action: Action, declared: Declaration, params: KeypointsParams) -> DetectedVideo:
    from imocap_core.adapters.detected_people import followed_video
    from imocap_core.pipeline.action import path_of

    given = action.detected.get(declared.id) if declared.detected else declared.keypoints
    path = None if declared.video is None else path_of(action.folder, declared.video)
    folder = None if given is None else action.folder / given
    return followed_video(declared, folder, path, action.file, params)


def _summary(number: int, score: float, track: PersonTrack, people: TrackedVideo) -> PersonSummary:
    from imocap_core.people.tracking import box_of

    middle = len(track.frames) // 2
    x0, y0, x1, y1 = (float(value) for value in box_of(track.poses[middle]))
    return PersonSummary(
        number=number,
        first_frame=int(people.frames[track.frames[0]]),
        last_frame=int(people.frames[track.frames[-1]]),
        share=len(track.frames) / len(people.people),
        score=score / people.ranked[0][0],
        box_px=(x0, y0, x1, y1),
        box_frame=int(people.frames[track.frames[middle]]),
    )


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

"""One video of an action: its detections read, its pictures looked through, everybody tracked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from imocap_core.io.video_check import why_not_detected
from imocap_core.params import KeypointsParams
from imocap_core.pipeline.action import Declaration
from imocap_core.problem.detected_people import DetectedVideo, read_people
from imocap_core.problem.tracked_people import declared_row, track_people
from imocap_core.problem.video_survey import survey_video


def tracked_video(
    declared: Declaration,
    folder: Path | None,
    video: Path | None,
    action_file: Path,
    params: KeypointsParams,
) -> DetectedVideo:
    """Everybody in a video, followed, and the declared performer among them.

    Arguments and errors as of `followed_video`; besides, ValueError when nobody is where
    action.yaml says that the performer is.
    """
    video_people = followed_video(declared, folder, video, action_file, params)
    declared_row(video_people.people, action_file)
    return video_people


def followed_video(
    declared: Declaration,
    folder: Path | None,
    video: Path | None,
    action_file: Path,
    params: KeypointsParams,
) -> DetectedVideo:
    """Everybody in a video, followed.

    Args:
        folder: the detections; None where the detector passed the video over.
        video: the file, None where there is none.

    Raises:
        ValueError: a file or a declaration is wrong, or nobody is in the used frames.
    """
    if folder is None:
        assert video is not None
        raise ValueError(why_not_detected(video))
    detected = read_people(declared, folder, video, action_file)
    frames, size, fps = detected.people.frames, detected.people.size, detected.people.fps
    survey = None if video is None else survey_video(video, frames, size, fps)
    people = track_people(detected.people, video, params)
    if not people.ranked:
        raise ValueError(
            f"{folder}: expected a person in frames {frames[0]} to {frames[-1]}, found nobody with "
            f"joints above confidence {params.min_confidence}; check the detections of "
            f"{declared.id} and its `frames` in action.yaml"
        )
    return replace(detected, people=people, survey=survey)

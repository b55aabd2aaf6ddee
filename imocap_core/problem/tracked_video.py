"""One video of an action: its detections read, its pictures looked through, everybody tracked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from imocap_core.io.video_check import why_not_detected
from imocap_core.params import KeypointsParams
from imocap_core.pipeline.action import Declaration
from imocap_core.problem.cuts import shot_inside
from imocap_core.problem.detected_people import DetectedVideo, read_people
from imocap_core.problem.tracked_people import declared_row, track_people
from imocap_core.problem.video_survey import VideoSurvey, survey_video
from imocap_core.runs import runs


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
    if survey is not None and params.cuts:
        inside = shot_inside(survey.cuts, frames, fps)
        detected, survey = _inside(detected, survey, *inside)
        frames = detected.people.frames
    people = track_people(detected.people, video, params)
    if not people.ranked:
        raise ValueError(
            f"{folder}: expected a person in frames {frames[0]} to {frames[-1]}, found nobody with "
            f"joints above confidence {params.min_confidence}; check the detections of "
            f"{declared.id} and its `frames` in action.yaml"
        )
    return replace(detected, people=people, survey=survey)


def _inside(
    detected: DetectedVideo, survey: VideoSurvey, first: int, stop: int
) -> tuple[DetectedVideo, VideoSurvey]:
    """A video from one frame to before another: the others are of another shot."""
    people, frames = detected.people, detected.people.frames
    used = slice(first - int(frames[0]), stop - int(frames[0]))
    out = [*range(frames[0], first), *range(stop, frames[-1] + 1)]
    if not out:
        return detected, survey
    spans = " and ".join(f"{a} to {b}" if b > a else f"{a}" for a, b in _spans(out))
    remark = (
        f"the picture of frame{'s' if len(out) > 1 else ''} {spans} is of another shot: left out"
    )
    time_s = None if detected.time_s is None else detected.time_s[used]
    detected = replace(
        detected,
        people=replace(people, people=people.people[used], frames=frames[used]),
        time_s=time_s,
        remarks=(*detected.remarks, remark),
    )
    cuts = [cut for cut in survey.cuts if first < cut < stop]
    return detected, VideoSurvey(cuts, survey.damaged[used])


def _spans(numbers: list[int]) -> list[tuple[int, int]]:
    """First and last of each run of consecutive numbers."""
    inside = np.zeros(numbers[-1] - numbers[0] + 1, bool)
    inside[np.array(numbers) - numbers[0]] = True
    return [(numbers[0] + a, numbers[0] + b) for a, b in runs(inside)]

"""Everybody who was tracked in the videos of an action, from its detections."""

from __future__ import annotations

from dataclasses import replace

from imocap_core.errors import WorkFailed
from imocap_core.library.person_summary import PersonSummary, VideoPeople
from imocap_core.params import KeypointsParams
from imocap_core.people.tracking import PersonTrack, box_of
from imocap_core.pipeline.action import Action
from imocap_core.problem.cuts import advice
from imocap_core.problem.detected_people import read_people
from imocap_core.problem.tracked_people import TrackedVideo, choose_performers, track_people
from imocap_core.problem.video_survey import survey_video


def people_of(action: Action, params: KeypointsParams) -> list[VideoPeople]:
    """Everybody in an action's videos; WorkFailed where these cannot be read."""
    detected = []
    try:
        for declared in action.videos:
            given = action.detected.get(declared.id) if declared.detected else declared.keypoints
            assert given is not None
            path = None if declared.video is None else action.folder / declared.video
            video = read_people(declared, action.folder / given, path, action.file)
            detected.append(replace(video, people=track_people(video.people, path, params)))
        performers = choose_performers([video.people for video in detected], action.file, params)
    except (ValueError, OSError) as error:
        raise WorkFailed(str(error)) from None
    videos = []
    for video, performer in zip(detected, performers, strict=True):
        notes, people = [performer.note], video.people
        if video.video is not None and params.cuts:
            cuts = survey_video(video.video, people.frames, people.size, people.fps).cuts
            notes.append(advice(cuts, people.frames))
        tracks = [
            _summary(number, score, track, people)
            for number, (score, track) in enumerate(people.ranked, start=1)
        ]
        videos.append(VideoPeople(people.id, tracks, [note for note in notes if note]))
    return videos


def _summary(number: int, score: float, track: PersonTrack, people: TrackedVideo) -> PersonSummary:
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

"""Everybody who was tracked in the videos of an action, from its detections."""

from __future__ import annotations

from imocap_core.adapters.detected_people import DetectedVideo, followed_video, performer_keypoints
from imocap_core.adapters.tracked_people import TrackedVideo, choose_performers, declared_row
from imocap_core.errors import WorkFailed
from imocap_core.library.people import PersonSummary, VideoPeople
from imocap_core.params import KeypointsParams
from imocap_core.people.tracking import PersonTrack, box_of
from imocap_core.pipeline.action import Action, Declaration, path_of


def people_of(action: Action, params: KeypointsParams) -> list[VideoPeople]:
    """Everybody in an action's videos; of those that cannot be used, why.

    WorkFailed where none can be read.
    """
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
    """The note on the performer of every video without fault, as a run would choose them; further
    faults come to `faults`."""
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
    given = action.detected.get(declared.id) if declared.detected else declared.keypoints
    path = None if declared.video is None else path_of(action.folder, declared.video)
    folder = None if given is None else action.folder / given
    return followed_video(declared, folder, path, action.file, params)


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

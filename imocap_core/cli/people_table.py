"""What `imocap people` lists: everybody tracked in each video of an action."""

from __future__ import annotations

from dataclasses import dataclass, replace

from imocap_core.errors import WorkFailed
from imocap_core.people.tracking import PersonTrack, box_of
from imocap_core.pipeline.runner import Job
from imocap_core.problem.cuts import advice, cuts_of
from imocap_core.problem.detected_people import read_people
from imocap_core.problem.tracked_people import TrackedVideo, choose_performers, track_people


@dataclass(frozen=True)
class VideoPeople:
    """One video: a row per track (number, frames, presence, score, box), and sentences."""

    id: str
    rows: list[tuple[str, ...]]
    sentences: list[str]


def listing(job: Job) -> list[VideoPeople]:
    """Everybody in an action's videos; WorkFailed where these cannot be read."""
    action, params = job.action, job.settings.params.keypoints
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
        sentences, people = [performer.note], video.people
        if video.video is not None and params.cuts:
            cuts = cuts_of(video.video, people.frames, people.size)
            sentences.append(advice(cuts, people.frames))
        rows = [_row(n, s, t, people) for n, (s, t) in enumerate(people.ranked, start=1)]
        videos.append(VideoPeople(people.id, rows, [each for each in sentences if each]))
    return videos


def _row(number: int, score: float, track: PersonTrack, people: TrackedVideo) -> tuple[str, ...]:
    first, last = (int(people.frames[k]) for k in (track.frames[0], track.frames[-1]))
    middle = len(track.frames) // 2
    box = ", ".join(f"{value:.0f}" for value in box_of(track.poses[middle]))
    share = len(track.frames) / len(people.people)
    return (
        str(number),
        f"{first} to {last}",
        f"{share:.0%}",
        f"{score / people.ranked[0][0]:.2f}",
        f"[{box}] in frame {int(people.frames[track.frames[middle]])}",
    )

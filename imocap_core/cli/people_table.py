"""What `imocap people` lists: everybody followed in each video of an action."""

from __future__ import annotations

from dataclasses import dataclass, replace

from imocap_core.errors import WorkFailed
from imocap_core.people.named import box_of
from imocap_core.people.tracking import Track
from imocap_core.pipeline.runner import Job
from imocap_core.problem.cuts import advice, cuts_of
from imocap_core.problem.people import people_in
from imocap_core.problem.performers import Watched, followed, performers


@dataclass(frozen=True)
class People:
    """One video: a row a track (number, frames, share seen, score, box), and sentences."""

    id: str
    rows: list[tuple[str, ...]]
    said: list[str]


def listing(job: Job) -> list[People]:
    """Everybody in an action's videos; WorkFailed where these cannot be read."""
    action, params = job.action, job.settings.params.keypoints
    sources, seen = [], []
    try:
        for declared in action.videos:
            given = action.detected.get(declared.id) if declared.detected else declared.keypoints
            assert given is not None
            video = None if declared.video is None else action.folder / declared.video
            source = people_in(declared, action.folder / given, video, action.file)
            watched = followed(source.watched, video, params)
            sources.append(replace(source, watched=watched))
            seen.append(watched)
        chosen = performers(seen, action.file, params)
    except (ValueError, OSError) as error:
        raise WorkFailed(str(error)) from None
    found = []
    for source, watched, performer in zip(sources, seen, chosen, strict=True):
        said = [performer.note]
        if source.video is not None and params.cuts:
            said.append(advice(cuts_of(source.video, watched.frames, watched.size), watched.frames))
        rows = [_row(n, s, t, watched) for n, (s, t) in enumerate(watched.ranked, start=1)]
        found.append(People(watched.id, rows, [sentence for sentence in said if sentence]))
    return found


def _row(number: int, score: float, track: Track, watched: Watched) -> tuple[str, ...]:
    first, last = (int(watched.frames[k]) for k in (track.frames[0], track.frames[-1]))
    middle = len(track.frames) // 2
    box = ", ".join(f"{value:.0f}" for value in box_of(track.poses[middle]))
    at = int(watched.frames[track.frames[middle]])
    share = len(track.frames) / len(watched.people)
    return (
        str(number),
        f"{first} to {last}",
        f"{share:.0%}",
        f"{score / watched.ranked[0][0]:.2f}",
        f"[{box}] in frame {at}",
    )

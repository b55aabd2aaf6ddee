"""What an action.yaml declares that the videos contradict, in plain words."""

from __future__ import annotations

from collections.abc import Mapping

from imocap_core.limits import LEAST_FRAMES
from imocap_core.pipeline.action import Action, Declaration


def warnings_of(action: Action, counts: Mapping[str, int]) -> list[str]:
    """A sentence on all that a run would refuse or leave out; counts: frames of the files."""
    spans = {v.id: _span(v, counts.get(v.id)) for v in action.videos}
    sentences = []
    for video in action.videos:
        sentences += _of_video(video, counts.get(video.id))
    for number, anchor in enumerate(action.anchors, start=1):
        for name, frame in anchor.frames.items():
            first, stop = spans[name]
            if not first <= frame < stop:
                sentences.append(
                    f"Anchor {number} is on frame {frame} of {name}, which is not used "
                    f"({_words(first, stop)} are): remove the anchor or use more of {name}"
                )
    return sentences


def _span(video: Declaration, count: int | None) -> tuple[int, float]:
    return video.frames or (0, float("inf") if count is None else count)


def _of_video(video: Declaration, count: int | None) -> list[str]:
    first, stop = _span(video, count)
    sentences = []
    if count is not None and stop > count:
        sentences.append(f"{video.id} uses {_words(first, stop)}, but it has only {count} frames")
    if stop - first < LEAST_FRAMES:
        used = f"{video.id} uses {stop - first:.0f} frames"
        sentences.append(f"{used}: at least {LEAST_FRAMES} are needed to show a motion")
    person = video.person
    if person is not None and person.frame is not None and not first <= person.frame < stop:
        sentences.append(
            f"The performer of {video.id} is named in frame {person.frame}, which is not used: "
            "choose them again"
        )
    if video.keypoints is None:
        sentences.append(f"{video.id} has no keypoints: find people, or name a file in action.yaml")
    return sentences


def _words(first: int, stop: float) -> str:
    return f"frames {first} to {stop - 1:.0f}" if stop != float("inf") else f"frames from {first}"

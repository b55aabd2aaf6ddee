"""Anchors and forbidden spans of action.yaml, converted from source frames to used frames."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from imocap_core.artifacts.schemas import Keypoints, VideoKeypoints
from imocap_core.pipeline.hints import AnchorEntry, ForbiddenEntry
from imocap_core.sync import Anchor, Hints


def hints_of(
    anchors: Sequence[AnchorEntry],
    forbidden: Sequence[ForbiddenEntry],
    keypoints: Keypoints,
    file: str,
) -> Hints:
    """Hints by index of video and used frame; `file` names action.yaml in messages.

    What is declared of a video that was left out is not used.

    Raises:
        ValueError: names every anchor on a frame that is not used, and every span without any.
    """
    index = {v.id: k for k, v in enumerate(keypoints.videos)}
    videos = {v.id: v for v in keypoints.videos}
    faults: list[str] = []
    ties: list[Anchor] = []
    for n, anchor in enumerate(anchors):
        indices = {v: _used_index(videos[v], f) for v, f in anchor.frames.items() if v in videos}
        faults += [
            f"anchors.{n}: expected a used frame of {v}, {_range(videos[v])}, got "
            f"{anchor.frames[v]}"
            for v, t in indices.items()
            if t is None
        ]
        ends = [(index[v], t) for v, t in indices.items() if t is not None]
        ties += [Anchor(a, t, b, float(s), anchor.hard) for (a, t), (b, s) in combinations(ends, 2)]
    spans = []
    for n, entry in enumerate(forbidden):
        if entry.video not in videos:
            continue
        video = videos[entry.video]
        first, stop = (int(f) for f in np.searchsorted(video.frames, entry.frames))
        if first >= stop:
            faults.append(
                f"forbidden.{n}: expected frames of {video.id} within {_range(video)}, got "
                f"{list(entry.frames)}"
            )
        spans.append((index[entry.video], first, stop))
    if faults:
        raise ValueError("\n".join(f"{file}: {fault}" for fault in faults))
    return Hints(tuple(ties), tuple(spans))


def _used_index(video: VideoKeypoints, frame: int) -> int | None:
    """The index of the used frame that is nearest to a source frame among them."""
    if not video.frames[0] <= frame <= video.frames[-1]:
        return None
    return int(np.abs(video.source_frames - frame).argmin())


def _range(video: VideoKeypoints) -> str:
    return f"{int(video.frames[0])} to {int(video.frames[-1])}"

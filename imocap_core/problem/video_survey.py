"""A video's pictures looked through once: cuts between shots, and frames that are damaged."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Int

from imocap_core.io.video import read_checked_gray
from imocap_core.people.shots import find_cuts
from imocap_core.runs import runs

COMPARED_PX = 160  # larger side of the pictures that are compared
NEAR_S = 0.5  # damaged frames that are closer together are one span: what follows one is smeared
MOST_DAMAGED = 0.25  # of the used frames


@dataclass(frozen=True)
class VideoSurvey:
    """cuts: source frames with which a new shot begins. damaged: of each used frame, whether the
    decoder met errors in it or shortly before and after."""

    cuts: list[int]
    damaged: Bool[np.ndarray, " T"]

    def damaged_spans(self, frames: Int[np.ndarray, " T"]) -> list[tuple[int, int]] | None:
        """First and last source frame of each damaged span; None without any."""
        spans = [(int(frames[a]), int(frames[b])) for a, b in runs(self.damaged)]
        return spans or None


def survey_video(
    video: Path, frames: Int[np.ndarray, " T"], size: tuple[int, int], fps: float
) -> VideoSurvey:
    """Look through the used frames of a video.

    ValueError when it cannot be decoded, ends before its last used frame, or more of it is damaged
    than can be left out.
    """
    first, last = int(frames[0]), int(frames[-1])
    scale = min(1.0, COMPARED_PX / max(size))
    whole: list[bool] = []

    def pictures() -> Iterator[np.ndarray]:
        for _, picture, is_whole in read_checked_gray(video, first, last + 1, scale=scale):
            whole.append(is_whole)
            yield picture

    cuts = find_cuts(pictures())
    if len(whole) != len(frames):
        raise ValueError(
            f"{video}: expected frames {first} to {last}, the video ends after {len(whole)} of "
            "them; change `frames` in action.yaml or re-encode the video"
        )
    damaged = np.zeros(len(frames), bool)
    for a, b in runs(~np.array(whole), gap=round(NEAR_S * fps)):
        damaged[a : b + 1] = True
    if damaged.mean() > MOST_DAMAGED:
        a, b = np.flatnonzero(damaged)[[0, -1]] + first
        raise ValueError(
            f"{video}: {damaged.mean():.0%} of its frames are damaged (between frames {a} and "
            f"{b}); get the video again, or use another part: `frames` in action.yaml"
        )
    near = damaged | np.r_[False, damaged[:-1]]
    return VideoSurvey([first + cut for cut in cuts if not near[cut]], damaged)

"""Clocks of videos: frames per second of the action, where a video is in slow motion or time
lapse."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Clocks:
    """Frame rates and playback rates of the videos.

    Attributes:
        fps: frames per second of each file.
        rates: seconds of the action per second of each video: 1/8 = slow motion by 8.
    """

    fps: Sequence[float]
    rates: Float[np.ndarray, " M"]

    @property
    def action_fps(self) -> list[float]:
        """Frames per second of the action."""
        return [f / float(r) for f, r in zip(self.fps, self.rates, strict=True)]

    @property
    def evidence_fps(self) -> list[float]:
        """Frames per second in which errors of estimates persist: the geometric mean of the video's
        and the action's, because errors come partly of pictures, partly of poses."""
        return [f / float(np.sqrt(r)) for f, r in zip(self.fps, self.rates, strict=True)]

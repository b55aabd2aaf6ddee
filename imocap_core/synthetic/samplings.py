"""The paper's way to make one motion look unsynchronised: each video keeps other frames of it.

The first 2000 frames are sampled at 150 equal intervals (segments lie between). One video keeps
just these; every other video has further frames inside 50 of the segments. `paper` follows the
caption (any number of frames of each segment), `released` the counts found in the published lists:
the whole region (80 or 81 frames) lists its six anchors once more, which makes 296 or 297 frames.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Frames = NDArray[np.int64]

BASE = 150
CHOSEN = 50
WHOLE_REACH = 3  # segments on each side of the one anchor that is filmed without gaps
THIRDS, SIXTHS = 4, 5  # anchors with a third and with a sixth of their segment's frames
SAMPLINGS = ("released", "paper")


def base_frames(length: int) -> Frames:
    """150 frames at equal intervals over a clip, first and last included."""
    if length < 2 * BASE:
        raise ValueError(f"expected a clip of at least {2 * BASE} frames, got {length}")
    return np.linspace(0, length - 1, BASE).round().astype(np.int64)


def sample_frames(name: str, length: int, video: int, rng: np.random.Generator) -> Frames:
    """Source frames of a video in order; video 0 keeps the 150 frames alone.

    `released` lists the anchors of its whole region twice, as the published lists' counts ask for:
    the only counting of these parts that gives 296 or 297. Distinct, they would be 290 or 291.
    """
    if name not in SAMPLINGS:
        raise ValueError(f"sampling: expected one of {', '.join(SAMPLINGS)}, got {name!r}")
    base = base_frames(length)
    if video == 0:
        return base
    draw = _released if name == "released" else _paper
    return np.sort(np.concatenate([base, *draw(base, rng)])).astype(np.int64)


def _paper(base: Frames, rng: np.random.Generator) -> list[Frames]:
    chosen = rng.choice(BASE - 1, CHOSEN, replace=False)
    return [_some(base, s, int(rng.integers(1, len(_inside(base, s)) + 1)), rng) for s in chosen]


def _released(base: Frames, rng: np.random.Generator) -> list[Frames]:
    whole = int(rng.integers(WHOLE_REACH, BASE - 1 - WHOLE_REACH))
    near = range(whole - WHOLE_REACH, whole + WHOLE_REACH)
    rest = rng.choice([s for s in range(BASE - 1) if s not in near], CHOSEN - 1, replace=False)
    found = [np.arange(base[near.start], base[near.stop])]  # with the anchors that lie in it
    for rank, segment in enumerate(rest):
        length = int(base[segment + 1] - base[segment])
        part = 3 if rank < THIRDS else 6 if rank < THIRDS + SIXTHS else length
        found.append(_some(base, segment, length // part, rng))
    return found


def _inside(base: Frames, segment: int) -> Frames:
    return np.arange(base[segment] + 1, base[segment + 1])


def _some(base: Frames, segment: int, count: int, rng: np.random.Generator) -> Frames:
    return rng.choice(_inside(base, segment), count, replace=False)

"""The paper's simulation of unsynchronised videos: each video samples other frames of one motion.

The first 2000 frames are sampled at 150 equal intervals (segments lie between these anchors). The
first video has only these frames; every other video has further frames inside 50 of the segments.
`paper` follows the caption (any number of frames of each segment), `released` the counts of the
published lists: the fully sampled region (80 or 81 frames) lists its six anchors twice, which makes
296 or 297 frames.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Int64

BASE = 150
CHOSEN = 50
WHOLE_REACH = 3  # segments on each side of the anchor around which all frames are sampled
THIRDS, SIXTHS = 4, 5  # segments of which a third and a sixth of the frames are sampled
SAMPLINGS = ("released", "paper")


def base_frames(length: int) -> Int64[np.ndarray, "150"]:
    """150 frames at equal intervals over a clip, first and last included."""
    if length < 2 * BASE:
        raise ValueError(f"expected a clip of at least {2 * BASE} frames, got {length}")
    return np.linspace(0, length - 1, BASE).round().astype(np.int64)


def sample_frames(
    name: str, length: int, video: int, rng: np.random.Generator
) -> Int64[np.ndarray, " T"]:
    """Source frames of a video in order; video 0 has only the 150 base frames.

    name: a sampling. length: frames of the clip. `released` lists the anchors of its fully sampled
    region twice: no other counting gives the 296 or 297 frames of the published lists (distinct,
    they would be 290 or 291).
    """
    if name not in SAMPLINGS:
        raise ValueError(f"sampling: expected one of {', '.join(SAMPLINGS)}, got {name!r}")
    base = base_frames(length)
    if video == 0:
        return base
    draw = _released if name == "released" else _paper
    return np.sort(np.concatenate([base, *draw(base, rng)])).astype(np.int64)


def _paper(base: np.ndarray, rng: np.random.Generator) -> list[np.ndarray]:
    chosen = rng.choice(BASE - 1, CHOSEN, replace=False).tolist()
    return [_some(base, s, int(rng.integers(1, len(_inside(base, s)) + 1)), rng) for s in chosen]


def _released(base: np.ndarray, rng: np.random.Generator) -> list[np.ndarray]:
    whole = int(rng.integers(WHOLE_REACH, BASE - 1 - WHOLE_REACH))
    near = range(whole - WHOLE_REACH, whole + WHOLE_REACH)
    rest = rng.choice([s for s in range(BASE - 1) if s not in near], CHOSEN - 1, replace=False)
    frames = [np.arange(base[near.start], base[near.stop])]  # including its anchors
    for rank, segment in enumerate(rest.tolist()):
        length = int(base[segment + 1] - base[segment])
        part = 3 if rank < THIRDS else 6 if rank < THIRDS + SIXTHS else length
        frames.append(_some(base, segment, length // part, rng))
    return frames


def _inside(base: np.ndarray, segment: int) -> Int64[np.ndarray, " N"]:
    return np.arange(base[segment] + 1, base[segment + 1])


def _some(
    base: np.ndarray, segment: int, count: int, rng: np.random.Generator
) -> Int64[np.ndarray, " N"]:
    return rng.choice(_inside(base, segment), count, replace=False)

"""Shots of a film: the spans between its cuts and gradual transitions."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from jaxtyping import UInt8

from imocap_core.collect.bars import without_bars
from imocap_core.collect.gradual import BLANK, Transition, gradual_transitions, without_flashes
from imocap_core.people.shots import THUMB, best_correlation, find_cuts, thumbnail

CHUNK, OVERLAP = 2000, 100  # frames looked through together
STILL = 4.0  # grey levels: of a still shot hardly any pixel differs by more between two frames
STILL_SHARE = 0.99  # of the pixels
LEAST_CHANGE = 10.0  # grey levels
LARGE_AREA = 0.3  # of the picture
LEAST_STEP = 0.07  # 1 - correlation, across a cut between shots that are composed alike,
TIMES = 6.0  # and so many times that between the frames beside it
LEAST_FRAMES = 3  # what is shorter is a part of a transition


@dataclass(frozen=True)
class Shot:
    """Frames of one take of one camera: first and one past the last, and the boundaries' kinds.

    begins, ends: start, end (of the film), cut, dissolve, wipe, fade or blank. still: the picture
    does not move.
    """

    first: int
    stop: int
    begins: str
    ends: str
    still: bool = False


def small(gray: UInt8[np.ndarray, "H W"]) -> UInt8[np.ndarray, "27 48"]:
    """A grey picture reduced in size."""
    return np.asarray(cv2.resize(gray, THUMB, interpolation=cv2.INTER_AREA), np.uint8)


def find_shots(pictures: Iterable[UInt8[np.ndarray, "H W"]]) -> list[Shot]:
    """Shot boundary detection: the shots of a film, from its grey pictures."""
    reduced = [small(picture) for picture in pictures]
    if not reduced:
        return []
    thumbs = without_flashes(np.stack(reduced))
    boundaries = _boundaries(thumbs)
    edges = [Transition(0, 0, "start"), *boundaries, Transition(len(thumbs), len(thumbs), "end")]
    return [
        Shot(a.stop, b.first, a.kind, b.kind, _is_still(thumbs[a.stop : b.first]))
        for a, b in pairwise(edges)
        if b.first - a.stop >= LEAST_FRAMES or len(edges) == 2
    ]


def _boundaries(thumbs: UInt8[np.ndarray, "T h w"]) -> list[Transition]:
    """Cuts (of no frames) and gradual transitions, in order."""
    cuts: set[int] = set()
    gradual: list[Transition] = []
    for begin in range(0, len(thumbs), CHUNK):
        first, stop = max(0, begin - OVERLAP), begin + CHUNK
        part = thumbs[first : stop + OVERLAP]
        pictures = [without_bars(thumb) for thumb in part]
        every = {first + cut for cut in (*find_cuts(pictures), *_faint_cuts(pictures))}
        cuts |= {cut for cut in every if begin <= cut < stop}
        moved = [
            Transition(first + t.first, first + t.stop, t.kind) for t in gradual_transitions(part)
        ]
        gradual += [t for t in moved if t.stop > begin and t.first < stop]
    merged = _without_overlap(sorted(gradual, key=lambda t: (t.first, t.stop)))
    hard = [
        Transition(cut, cut, "cut")
        for cut in sorted(cuts)
        if not any(t.first <= cut <= t.stop for t in merged)
    ]
    return sorted([*merged, *hard], key=lambda t: t.first)


def _faint_cuts(pictures: Sequence[UInt8[np.ndarray, "h w"]]) -> list[int]:
    """Cuts between shots that are composed alike (a light wall over a dark floor in both): a large
    part of the picture changes at once, and much more than between the frames on either side."""
    stack = np.stack(pictures).astype(np.float32)
    area = (np.abs(np.diff(stack, axis=0)) > LEAST_CHANGE).mean(axis=(1, 2))
    cuts = []
    for t in (np.flatnonzero(area > LARGE_AREA) + 1).tolist():
        near = [thumbnail(picture) for picture in pictures[max(0, t - 2) : t + 2]]
        middle = min(t, 2)
        unlike = [1 - best_correlation(a, b) for a, b in pairwise(near)]
        step = unlike.pop(middle - 1)
        if step > LEAST_STEP and TIMES * max(unlike, default=0.0) < step:
            cuts.append(t)
    return cuts


def _without_overlap(transitions: Sequence[Transition]) -> list[Transition]:
    """Transitions that touch or overlap as one, with the kind of the longest that is not blank."""
    merged: list[Transition] = []
    for t in transitions:
        if merged and t.first <= merged[-1].stop:
            last = merged[-1]
            kind = max((last, t), key=lambda x: (x.kind != "blank", x.stop - x.first)).kind
            merged[-1] = Transition(last.first, max(last.stop, t.stop), kind)
        else:
            merged.append(t)
    return merged


def _is_still(thumbs: UInt8[np.ndarray, "T h w"]) -> bool:
    """Whether no frame differs from the middle one by more than coding does."""
    if thumbs[0].std() < BLANK:
        return True
    middle = thumbs[len(thumbs) // 2].astype(np.float32)
    change = np.quantile(np.abs(thumbs - middle), STILL_SHARE, axis=(1, 2))
    return bool(change.max() < STILL)

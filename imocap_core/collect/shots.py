"""Shots of a film: the spans between its cuts and gradual transitions.

Gradual transitions between shots: dissolves, wipes, and fades through a blank picture. Between its
last frame A of one shot and its first frame B of the next, every pixel of a dissolve or a wipe lies
between its values in A and in B, and the share of B only grows. The pixels of a camera that turns,
or of what moves in front of it, take any values in between. A fade is found by its blank frames:
away from them the contrast only grows.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from scipy.ndimage import maximum_filter1d

from imocap_core.people.shot_boundaries import ALIKE, THUMB, best_correlation, find_cuts, thumbnail
from imocap_core.sequences import runs

DARK = 24  # grey level: no pixel of a bar is brighter
LEAST_AREA = 0.2  # of the picture: what is left is its content, else all of it is dark


def content(gray: UInt8[np.ndarray, "H W"]) -> tuple[slice, slice]:
    """Rows and columns of a picture without its bars; all of them where it is dark everywhere."""
    bright = gray > DARK
    rows, columns = (np.flatnonzero(bright.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return slice(0, gray.shape[0]), slice(0, gray.shape[1])
    inside = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    area = (inside[0].stop - inside[0].start) * (inside[1].stop - inside[1].start)
    if area < LEAST_AREA * gray.size:
        return slice(0, gray.shape[0]), slice(0, gray.shape[1])
    return inside


def without_bars(gray: UInt8[np.ndarray, "H W"]) -> UInt8[np.ndarray, "H W"]:
    """The picture with its bars as bright as its content on average: they have no contrast."""
    inside = content(gray)
    filled = np.full_like(gray, round(float(gray[inside].mean())))
    filled[inside] = gray[inside]
    return filled


WIDTHS = (5, 9, 13, 17, 25, 37)  # frames from A to B that are tried
RESTING = 0.4  # of the mean step: the first and the last are smaller
UNLIKE = 0.7  # correlation of A and B is below it
LEAST_CHANGE = 10.0  # grey levels, root mean square, from A to B
LEAST_GRADUAL_AREA = 0.12  # of the picture changes by as much: more than a person who moves
OUTSIDE = 0.06  # of the squared change: what lies outside [A, B]
BACK = 0.06  # of the change: so much may be lost again from frame to frame
LARGEST_STEP = 0.6  # of the change; more within one frame is a cut
UNEVEN = 4.5  # the largest step is at most so many times the mean one
REST = 0.08  # of the change: frames with less (or all but less) belong to the shots
BLANK = 4.0  # grey levels: standard deviation of a blank picture
PALE = 0.2  # of the largest contrast near it: a picture with less is blank too
GROWTH = 1.01  # of the contrast, from frame to frame of a fade
LONGEST_FADE = 45  # frames, on either side of the blank ones
FLASH = 5  # bright blank frames between pictures that are alike are a flash, if no more


@dataclass(frozen=True)
class Transition:
    """A gradual transition: first and one past the last frame, which belong to no shot."""

    first: int
    stop: int
    kind: str


def _gradual_transitions(thumbs: UInt8[np.ndarray, "T h w"]) -> list[Transition]:
    """The gradual transitions of a film, from its pictures reduced in size, in order."""
    flat = thumbs.reshape(len(thumbs), -1).astype(np.float32)
    pictures = np.stack([without_bars(thumb) for thumb in thumbs])
    fades = _fades(flat)
    covered = np.zeros(len(thumbs), dtype=bool)
    for fade in fades:
        covered[fade.first : fade.stop] = True
    mixed = np.zeros(len(thumbs), dtype=bool)
    for width in WIDTHS:
        begins = _unlike_pairs(pictures, flat, width)
        clear = [t for t in begins if not covered[t : t + width + 1].any()]
        mixed |= _mixed_frames(pictures, flat, width, clear)
    dissolves = [
        Transition(a, b + 1, "dissolve") for a, b in runs(mixed, least=2) if b - a + 1 >= 2
    ]
    wipes = [_named(thumbs, t) for t in dissolves]
    return sorted([*fades, *wipes], key=lambda t: t.first)


def _without_flashes(thumbs: UInt8[np.ndarray, "T h w"]) -> UInt8[np.ndarray, "T h w"]:
    """The film with bright blank frames replaced by the one before, where the pictures before and
    after them are alike."""
    calm = thumbs.copy()
    flat = thumbs.reshape(len(thumbs), -1).astype(np.float32)
    contrast, light = flat.std(axis=1), flat.mean(axis=1)
    for a, b in runs(contrast < np.maximum(BLANK, PALE * np.median(contrast))):
        inside = a > 0 and b + 1 < len(thumbs) and b - a < FLASH
        if inside and light[a : b + 1].min() > max(light[a - 1], light[b + 1]):
            before, after = (without_bars(thumbs[t]) for t in (a - 1, b + 1))
            if _alike(before, after):
                calm[a : b + 1] = thumbs[a - 1]
    return calm


def _mixed_frames(
    pictures: UInt8[np.ndarray, "T h w"],
    flat: Float[np.ndarray, "T P"],
    width: int,
    begins: Sequence[int],
) -> Bool[np.ndarray, " T"]:
    """The frames within transitions from A, one of `begins`, to B, `width` frames later."""
    mixed = np.zeros(len(flat), dtype=bool)
    for t in begins:
        A, B = flat[t], flat[t + width]
        change = B - A
        energy = float(change @ change)
        inner = flat[t : t + width + 1]
        share = (inner - A) @ change / energy
        steps = np.diff(share)
        if steps.min() < -BACK or steps.max() > LARGEST_STEP:
            continue
        low, high = np.minimum(A, B), np.maximum(A, B)
        outside = np.maximum(inner - high, 0) + np.maximum(low - inner, 0)
        if float((outside**2).sum(axis=1).max()) > OUTSIDE * energy:
            continue
        between = np.flatnonzero((share > REST) & (share < 1 - REST))
        if len(between) < 2 or between[0] < 2 or between[-1] > width - 2:
            continue  # no frame of the shots beside it, but A and B
        mean_step = 1 / (len(between) + 1)
        at_rest = max(steps[0], steps[-1]) < RESTING * mean_step
        even = at_rest and steps.max() <= UNEVEN * mean_step
        if even and not _alike(pictures[t], pictures[t + width], UNLIKE):  # in another place too
            mixed[t + between[0] : t + between[-1] + 1] = True
    return mixed


def _unlike_pairs(
    pictures: UInt8[np.ndarray, "T h w"], flat: Float[np.ndarray, "T P"], width: int
) -> list[int]:
    """Frames t that differ from frame t + width, in brightness and in what they show."""
    if len(flat) <= width:
        return []
    centred = pictures.reshape(len(pictures), -1).astype(np.float32)
    centred -= centred.mean(axis=1, keepdims=True)
    spread = np.sqrt((centred**2).mean(axis=1))
    product = (centred[:-width] * centred[width:]).mean(axis=1)
    correlation = product / np.maximum(spread[:-width] * spread[width:], 1e-6)
    change = np.sqrt(((flat[width:] - flat[:-width]) ** 2).mean(axis=1))
    area = (np.abs(flat[width:] - flat[:-width]) > LEAST_CHANGE).mean(axis=1)
    full = (spread[:-width] > BLANK) & (spread[width:] > BLANK)
    return np.flatnonzero(
        (correlation < UNLIKE) & (change > LEAST_CHANGE) & (area > LEAST_GRADUAL_AREA) & full
    ).tolist()


def _fades(flat: Float[np.ndarray, "T P"]) -> list[Transition]:
    """Blank frames, and the frames about them in which the contrast grows from frame to frame."""
    contrast = flat.std(axis=1)
    usual = maximum_filter1d(contrast, 2 * LONGEST_FADE + 1)
    fades = []
    for a, b in runs(contrast < np.maximum(BLANK, PALE * usual)):
        first = a - _growing(contrast[max(0, a - LONGEST_FADE) : a + 1][::-1])
        stop = b + 1 + _growing(contrast[b : b + 1 + LONGEST_FADE])
        fades.append(Transition(first, stop, "fade" if stop - first > b - a + 1 else "blank"))
    return fades


def _growing(contrast: Float[np.ndarray, " n"]) -> int:
    """How many values after the first are larger than the one before and smaller than the next."""
    grows = contrast[1:] > GROWTH * contrast[:-1] + 0.05
    steps = int(np.argmin(grows)) if not grows.all() else len(grows)
    return max(steps - 1, 0)


def _alike(a: UInt8[np.ndarray, "h w"], b: UInt8[np.ndarray, "h w"], least: float = ALIKE) -> bool:
    """Whether two pictures correlate by more, as they are or moved a little."""
    return best_correlation(thumbnail(a), thumbnail(b)) > least


def _named(thumbs: UInt8[np.ndarray, "T h w"], t: Transition) -> Transition:
    """A wipe where most pixels change within a few frames, a dissolve where they change slowly."""
    inner = thumbs[max(0, t.first - 1) : t.stop + 1].astype(np.float32)
    change = np.abs(inner[-1] - inner[0])
    steps = np.abs(np.diff(inner, axis=0)).max(axis=0)
    moved = change > LEAST_CHANGE
    sudden = float(np.median(steps[moved] / change[moved])) if moved.any() else 0.0
    return Transition(t.first, t.stop, "wipe" if sudden > 0.7 and len(inner) > 4 else "dissolve")


CHUNK, OVERLAP = 2000, 100  # frames looked through together
STILL = 4.0  # grey levels: of a still shot hardly any pixel differs by more between two frames
STILL_SHARE = 0.99  # of the pixels
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
    thumbs = _without_flashes(np.stack(reduced))
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
            Transition(first + t.first, first + t.stop, t.kind) for t in _gradual_transitions(part)
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

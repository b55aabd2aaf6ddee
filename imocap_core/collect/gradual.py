"""Gradual transitions between shots: dissolves, wipes, and fades through a blank picture.

Between its last frame A of one shot and its first frame B of the next, every pixel of a dissolve
or a wipe lies between its values in A and in B, and the share of B only grows. The pixels of a
camera that turns, or of what moves in front of it, take any values in between. A fade is found by
its blank frames: away from them the contrast only grows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, UInt8
from scipy.ndimage import maximum_filter1d

from imocap_core.collect.bars import without_bars
from imocap_core.people.shots import ALIKE, best_correlation, thumbnail
from imocap_core.runs import runs

WIDTHS = (5, 9, 13, 17, 25, 37)  # frames from A to B that are tried
RESTING = 0.4  # of the mean step: the first and the last are smaller
UNLIKE = 0.7  # correlation of A and B is below it
LEAST_CHANGE = 10.0  # grey levels, root mean square, from A to B
LEAST_AREA = 0.12  # of the picture changes by as much: more than a person who moves
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


def gradual_transitions(thumbs: UInt8[np.ndarray, "T h w"]) -> list[Transition]:
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


def without_flashes(thumbs: UInt8[np.ndarray, "T h w"]) -> UInt8[np.ndarray, "T h w"]:
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
        (correlation < UNLIKE) & (change > LEAST_CHANGE) & (area > LEAST_AREA) & full
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

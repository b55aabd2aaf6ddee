"""People told apart by their clothes: colours of the upper and of the lower half of the box.

Motion alone loses people who cross or leave the picture. Where two tracks met, their ends are
exchanged if the looks before and after clearly say so; a track that ends and one that begins later
are one if they look alike and nobody else looks like it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from imocap_core.people.named import box_of
from imocap_core.people.tracking import Track

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
Looks = Mapping[int, Array]  # frame -> look, of one track, in some of its frames

BINS = 4  # a channel
HALVES = ((0.15, 0.5), (0.5, 0.85))  # of the box's height: shirt, trousers
INNER = (0.3, 0.7)  # of its width: background stays out
OVERLAP = 0.15  # of two boxes (intersection over union): they meet
CLEAR = 12  # looks compared on either side of a meeting
MARGIN = 0.12  # by which crossed looks must be nearer than straight ones
SAME = 0.25  # looks of one person differ by less


def look_of(picture: Picture, pose: Array) -> Array:
    """Square roots of colour shares (2 * BINS^3,) of a person (K, 3) in a picture (H, W, 3)."""
    x0, y0, x1, y1 = box_of(pose)
    height, width = picture.shape[:2]
    columns = np.clip([x0 + s * (x1 - x0) for s in INNER], 0, width - 1).astype(int)
    shares = []
    for part in HALVES:
        rows = np.clip([y0 + s * (y1 - y0) for s in part], 0, height - 1).astype(int)
        patch = picture[rows[0] : rows[1] + 1, columns[0] : columns[1] + 1]
        lab = cv2.cvtColor(np.ascontiguousarray(patch), cv2.COLOR_RGB2LAB)
        ranges = [0, 256, 64, 192, 64, 192]  # a and b of clothes lie near the middle
        inside = [np.clip(lab[..., 0], 0, 255), *(np.clip(lab[..., c], 64, 191) for c in (1, 2))]
        clipped = np.stack(inside, -1).astype(np.uint8)
        counts = cv2.calcHist([clipped], [0, 1, 2], None, [BINS] * 3, ranges).ravel()
        shares.append(counts / max(counts.sum(), 1.0))
    return np.sqrt(np.concatenate(shares).astype(np.float64) / 2)


def apart(a: Array, b: Array) -> float:
    """Hellinger distance of two looks, 0 to 1."""
    return float(np.sqrt(max(0.0, 1.0 - float(a @ b))))


def exchange_where_met(
    tracks: Sequence[Track], looks: Sequence[Looks]
) -> tuple[list[Track], list[Looks]]:
    """The tracks with their ends exchanged after meetings where the looks say so."""
    tracks, looks = list(tracks), list(looks)
    for i in range(len(tracks)):
        for k in range(i + 1, len(tracks)):
            for last in meetings(tracks[i], tracks[k]):
                if _crossed(looks[i], looks[k], last):
                    tracks[i], tracks[k] = _exchanged(tracks[i], tracks[k], last[1])
                    looks[i], looks[k] = _exchanged_looks(looks[i], looks[k], last[1])
    return tracks, looks


def join_by_looks(
    tracks: Sequence[Track], looks: Sequence[Looks]
) -> tuple[list[Track], list[Looks]]:
    """Tracks joined where one ends, another begins, both look alike and no third one does."""
    tracks, looks = list(tracks), list(looks)
    while True:
        pair = _alike(tracks, looks)
        if pair is None:
            return tracks, looks
        i, k = pair
        tracks[i] = Track(tracks[i].frames + tracks[k].frames, tracks[i].poses + tracks[k].poses)
        looks[i] = {**looks[i], **looks[k]}
        del tracks[k], looks[k]


def meetings(a: Track, b: Track) -> list[tuple[int, int]]:
    """First and last frame of each time in which the boxes of two tracks overlap."""
    at = dict(zip(b.frames, b.poses, strict=True))
    met = [f for f, pose in zip(a.frames, a.poses, strict=True) if f in at and _meet(pose, at[f])]
    found: list[tuple[int, int]] = []
    for frame in met:
        if found and frame - found[-1][1] <= CLEAR:
            found[-1] = (found[-1][0], frame)
        else:
            found.append((frame, frame))
    return found


def _meet(a: Array, b: Array) -> bool:
    u, v = box_of(a), box_of(b)
    inside = float(np.prod(np.clip(np.minimum(u, v)[2:] - np.maximum(u, v)[:2], 0, None)))
    whole = float(np.prod(u[2:] - u[:2]) + np.prod(v[2:] - v[:2])) - inside
    return inside > OVERLAP * max(whole, 1e-9)


def _crossed(a: Looks, b: Looks, meeting: tuple[int, int]) -> bool:
    """Whether a's look before is b's after, and b's before a's after."""
    first, last = meeting
    before = [_mean([x for f, x in sorted(own.items()) if f < first][-CLEAR:]) for own in (a, b)]
    after = [_mean([x for f, x in sorted(own.items()) if f > last][:CLEAR]) for own in (a, b)]
    if any(x is None for x in (*before, *after)):
        return False
    (a0, b0), (a1, b1) = before, after
    assert a0 is not None
    assert b0 is not None
    assert a1 is not None
    assert b1 is not None
    return apart(a0, b1) + apart(b0, a1) + MARGIN < apart(a0, a1) + apart(b0, b1)


def _mean(some: Sequence[Array]) -> Array | None:
    """A mean look: shares are averaged, not their roots."""
    return np.sqrt(np.mean(np.square(some), axis=0)) if len(some) else None


def _exchanged(a: Track, b: Track, after: int) -> tuple[Track, Track]:
    def whole(early: Track, late: Track) -> Track:
        rows = [
            (f, p)
            for track, wanted in ((early, False), (late, True))
            for f, p in zip(track.frames, track.poses, strict=True)
            if (f > after) == wanted
        ]
        return Track([f for f, _ in rows], [p for _, p in rows])

    return whole(a, b), whole(b, a)


def _exchanged_looks(a: Looks, b: Looks, after: int) -> tuple[Looks, Looks]:
    early = [{f: x for f, x in own.items() if f <= after} for own in (a, b)]
    late = [{f: x for f, x in own.items() if f > after} for own in (a, b)]
    return {**early[0], **late[1]}, {**early[1], **late[0]}


def _alike(tracks: Sequence[Track], looks: Sequence[Looks]) -> tuple[int, int] | None:
    """Rows of the best pair to be joined, the earlier one first."""
    means = [_mean(list(own.values())) for own in looks]
    best: tuple[float, int, int] | None = None
    for i, before in enumerate(tracks):
        for k, after in enumerate(tracks):
            u, v = means[i], means[k]
            if i == k or u is None or v is None or before.frames[-1] >= after.frames[0]:
                continue
            others = [apart(v, w) for n, w in enumerate(means) if n not in (i, k) and w is not None]
            own = apart(u, v)
            if own < SAME and own + MARGIN < min(others, default=1.0):
                best = min(best or (own, i, k), (own, i, k))
    return None if best is None else best[1:]

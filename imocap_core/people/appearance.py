"""People told apart by the colours of their clothes (re-identification by colour histograms).

Motion alone confuses people who cross or leave the picture. Where two tracks met, their ends are
swapped if the appearances before and after clearly say so; a track that ends and one that begins
later are joined if their appearances match and no third one does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from imocap_core.people.tracking import PersonTrack, box_of, box_overlap

Appearances = Mapping[int, Float[np.ndarray, " D"]]
"""Frame -> appearance, of one track, in some of its frames."""

BINS = 4  # per colour channel
HALVES = ((0.15, 0.5), (0.5, 0.85))  # of the box's height: shirt, trousers
INNER = (0.3, 0.7)  # of its width: excludes background
OVERLAP = 0.15  # of two boxes (intersection over union) that meet
COMPARED = 12  # appearances compared on either side of a meeting
MARGIN = 0.12  # by which swapped ends must match better than unswapped ones
SAME = 0.25  # appearances of one person differ by less


def appearance_of(
    picture: UInt8[np.ndarray, "H W 3"], pose: Float[np.ndarray, "K 3"]
) -> Float[np.ndarray, " D"]:
    """Colour histogram of a person's upper and lower half: square roots of shares, 2 BINS^3."""
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


def appearance_distance(a: Float[np.ndarray, " D"], b: Float[np.ndarray, " D"]) -> float:
    """Hellinger distance of two appearances, 0 to 1."""
    return float(np.sqrt(max(0.0, 1.0 - float(a @ b))))


def swap_after_meetings(
    tracks: Sequence[PersonTrack], appearances: Sequence[Appearances]
) -> tuple[list[PersonTrack], list[Appearances]]:
    """The tracks with their ends swapped after meetings where the appearances say so."""
    tracks, appearances = list(tracks), list(appearances)
    for i in range(len(tracks)):
        for k in range(i + 1, len(tracks)):
            for meeting in meetings(tracks[i], tracks[k]):
                if _crossed(appearances[i], appearances[k], meeting):
                    end = meeting[1]
                    tracks[i], tracks[k] = _swapped(tracks[i], tracks[k], end)
                    appearances[i], appearances[k] = _swapped_appearances(
                        appearances[i], appearances[k], end
                    )
    return tracks, appearances


def join_by_appearance(
    tracks: Sequence[PersonTrack], appearances: Sequence[Appearances]
) -> tuple[list[PersonTrack], list[Appearances]]:
    """Tracks joined where one ends, another begins, both look alike and no third one does."""
    tracks, appearances = list(tracks), list(appearances)
    while True:
        pair = _best_match(tracks, appearances)
        if pair is None:
            return tracks, appearances
        i, k = pair
        tracks[i] = PersonTrack(
            tracks[i].frames + tracks[k].frames, tracks[i].poses + tracks[k].poses
        )
        appearances[i] = {**appearances[i], **appearances[k]}
        del tracks[k], appearances[k]


def meetings(a: PersonTrack, b: PersonTrack) -> list[tuple[int, int]]:
    """First and last frame of each time in which the boxes of two tracks overlap."""
    poses_b = dict(zip(b.frames, b.poses, strict=True))
    overlapping = [
        frame
        for frame, pose in zip(a.frames, a.poses, strict=True)
        if frame in poses_b and box_overlap(box_of(pose), box_of(poses_b[frame])) > OVERLAP
    ]
    spans: list[tuple[int, int]] = []
    for frame in overlapping:
        if spans and frame - spans[-1][1] <= COMPARED:
            spans[-1] = (spans[-1][0], frame)
        else:
            spans.append((frame, frame))
    return spans


def _crossed(a: Appearances, b: Appearances, meeting: tuple[int, int]) -> bool:
    """Whether a's appearance before the meeting is b's after it, and b's before is a's after."""
    first, last = meeting
    before = [
        _mean([x for f, x in sorted(each.items()) if f < first][-COMPARED:]) for each in (a, b)
    ]
    after = [_mean([x for f, x in sorted(each.items()) if f > last][:COMPARED]) for each in (a, b)]
    if any(x is None for x in (*before, *after)):
        return False
    (a0, b0), (a1, b1) = before, after
    assert a0 is not None
    assert b0 is not None
    assert a1 is not None
    assert b1 is not None
    swapped = appearance_distance(a0, b1) + appearance_distance(b0, a1)
    return swapped + MARGIN < appearance_distance(a0, a1) + appearance_distance(b0, b1)


def _mean(appearances: Sequence[Float[np.ndarray, " D"]]) -> Float[np.ndarray, " D"] | None:
    """Mean appearance: shares are averaged, not their roots."""
    return np.sqrt(np.mean(np.square(appearances), axis=0)) if len(appearances) else None


def _swapped(a: PersonTrack, b: PersonTrack, after: int) -> tuple[PersonTrack, PersonTrack]:
    def whole(early: PersonTrack, late: PersonTrack) -> PersonTrack:
        rows = [
            (frame, pose)
            for track, is_late in ((early, False), (late, True))
            for frame, pose in zip(track.frames, track.poses, strict=True)
            if (frame > after) == is_late
        ]
        return PersonTrack([frame for frame, _ in rows], [pose for _, pose in rows])

    return whole(a, b), whole(b, a)


def _swapped_appearances(
    a: Appearances, b: Appearances, after: int
) -> tuple[Appearances, Appearances]:
    early = [{f: x for f, x in each.items() if f <= after} for each in (a, b)]
    late = [{f: x for f, x in each.items() if f > after} for each in (a, b)]
    return {**early[0], **late[1]}, {**early[1], **late[0]}


def _best_match(
    tracks: Sequence[PersonTrack], appearances: Sequence[Appearances]
) -> tuple[int, int] | None:
    """Rows of the best pair to join, the earlier one first."""
    means = [_mean(list(each.values())) for each in appearances]
    best: tuple[float, int, int] | None = None
    for i, before in enumerate(tracks):
        for k, after in enumerate(tracks):
            u, v = means[i], means[k]
            if i == k or u is None or v is None or before.frames[-1] >= after.frames[0]:
                continue
            others = [
                appearance_distance(v, w)
                for n, w in enumerate(means)
                if n not in (i, k) and w is not None
            ]
            distance = appearance_distance(u, v)
            if distance < SAME and distance + MARGIN < min(others, default=1.0):
                best = min(best or (distance, i, k), (distance, i, k))
    return None if best is None else best[1:]

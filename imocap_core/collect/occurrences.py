"""Occurrences of the action: matches with their view, size and visibility, in the film's frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.collect.matching import Match
from imocap_core.collect.shots import Shot
from imocap_core.collect.tracks import ShotTrack
from imocap_core.conventions import SMPL_JOINTS

Box = tuple[float, float, float, float]  # left, top, right, bottom

SAME = 0.5  # of the shorter in time, and of both boxes: two tracks of one person
SIZE_PX = 150.0  # a person of this size counts half as much as one of any size
SIDES = ("front", "left side", "back", "right side")
ACROSS = [
    (SMPL_JOINTS.index(f"left_{x}"), SMPL_JOINTS.index(f"right_{x}")) for x in ("hip", "shoulder")
]


@dataclass(frozen=True)
class Occurrence:
    """One performance of the action in a film.

    film, shot, track: indices (track: rank in its shot). first, stop: frames of the film, with a
    margin. rate: speed, times the template's. azimuth_deg: of the camera about the performer, 0 in
    front, 90 at the left. height_px: diagonal of the person's box. visible: share of its frames
    with the person; confidence: mean of the keypoints'. box_px: in the frame `box_frame`. alone:
    nobody else is followed in the shot.
    """

    film: int
    shot: int
    track: int
    first: int
    stop: int
    rate: float
    score: float
    mirrored: bool
    mirror_margin: float
    azimuth_deg: float
    height_px: float
    visible: float
    confidence: float
    box_px: Box
    box_frame: int
    alone: bool

    @property
    def quality(self) -> float:
        """Likeness, visibility and size in one number, at most 1; slow motion loses a little."""
        size = self.height_px / (self.height_px + SIZE_PX)
        slow = min(self.rate, 1.0) ** 0.25
        return max(self.score, 0.0) * self.visible * self.confidence * size * slow

    @property
    def view(self) -> str:
        """The performer's side that the camera sees."""
        return SIDES[round(self.azimuth_deg / 90.0) % 4]


def occurrence_of(
    match: Match, track: ShotTrack, shot: Shot, margin_s: float, *, alone: bool
) -> Occurrence:
    """A match as an occurrence, with a margin as far as the track and its shot reach."""
    margin = round(margin_s * track.fps)
    first = max(track.first + match.first - margin, shot.first, track.first)
    stop = min(track.first + match.stop + margin, shot.stop, track.stop)
    rows = slice(match.first, match.stop)
    shown = np.isfinite(track.box_px[rows]).all(axis=1)
    boxes = track.box_px[rows][shown]
    middle = np.flatnonzero(shown)[shown.sum() // 2] if shown.any() else 0
    box = track.box_px[match.first + middle]
    azimuth = _azimuth_deg(track.joints[rows])
    heights = np.hypot(boxes[:, 2] - boxes[:, 0], boxes[:, 3] - boxes[:, 1])
    x0, y0, x1, y1 = (round(float(x), 1) for x in box)
    return Occurrence(
        film=track.film,
        shot=track.shot,
        track=track.track,
        first=first,
        stop=stop,
        rate=match.rate,
        score=match.score,
        mirrored=match.mirrored,
        mirror_margin=match.mirror_margin,
        azimuth_deg=-azimuth % 360 if match.mirrored else azimuth,
        height_px=float(np.median(heights)) if len(heights) else 0.0,
        visible=float(shown.mean()),
        confidence=float(track.confidence[rows][shown].mean()) if shown.any() else 0.0,
        box_px=(x0, y0, x1, y1),
        box_frame=track.first + match.first + int(middle),
        alone=alone,
    )


def _azimuth_deg(joints: Float[np.ndarray, "T 24 3"]) -> float:
    """Mean direction from which the performer is filmed, from 0 to 360."""
    across = sum(joints[:, left] - joints[:, right] for left, right in ACROSS)
    flat = np.asarray(across)[:, [0, 2]]
    flat = flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-6)
    x, z = flat.mean(axis=0)
    return float(np.degrees(np.arctan2(-z, x)) % 360)


def shows_same(a: Occurrence, b: Occurrence) -> bool:
    """Whether two tracks of one shot show the same person at the same time."""
    if (a.film, a.shot) != (b.film, b.shot) or a.track == b.track:
        return False
    shared = min(a.stop, b.stop) - max(a.first, b.first)
    together = shared > SAME * min(a.stop - a.first, b.stop - b.first)
    return together and _box_overlap(a.box_px, b.box_px) > SAME


def _box_overlap(a: Box, b: Box) -> float:
    """Intersection over union."""
    sides = [min(a[k + 2], b[k + 2]) - max(a[k], b[k]) for k in (0, 1)]
    both = max(sides[0], 0.0) * max(sides[1], 0.0)
    areas = [(x[2] - x[0]) * (x[3] - x[1]) for x in (a, b)]
    return both / max(sum(areas) - both, 1e-9)


def view_difference_deg(a: Occurrence, b: Occurrence) -> float:
    """Angle between the directions of two views, at most 180."""
    return abs((a.azimuth_deg - b.azimuth_deg + 180) % 360 - 180)

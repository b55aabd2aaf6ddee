"""Outlines of the people tracked in a video, as polygons in its pictures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from imocap_core.body.layouts import layout_names
from imocap_core.people.tracking import PersonTrack, box_of, size_of
from imocap_core.problem.tracked_people import NEGLIGIBLE, TrackedVideo

MASK_PX = 72.0  # diagonal of the person's box in the picture in which the outline is traced
LIMB = 0.075  # thickness of a limb over that diagonal
HEAD = 0.07  # radius of the head
MARGIN_PX = 10
MOST_PEOPLE = 12
MOST_FRAMES = 3000  # with outlines; longer videos have them every few frames
LIMBS = (
    ("shoulder", "elbow", "wrist"),
    ("hip", "knee", "ankle", "heel"),
    ("ankle", "big_toe"),
)


def outlines_of(video: TrackedVideo) -> dict[str, Any]:
    """Everybody in a video by frame: number as in `imocap people`, box and polygon in pixels."""
    step = max(1, math.ceil(len(video.frames) / MOST_FRAMES))
    names = layout_names(video.layout)
    best = video.ranked[0][0] if video.ranked else 1.0
    people = [
        {
            "number": number,
            "score": round(score / best, 3),
            "frames": [int(video.frames[t]) for t in track.frames[::step]],
            "boxes": [_whole(box_of(pose)) for pose in track.poses[::step]],
            "outlines": [_whole(outline(pose, names)) for pose in track.poses[::step]],
        }
        for number, (score, track) in enumerate(video.ranked[:MOST_PEOPLE], start=1)
        if number == 1 or _counts(score, best, track)
    ]
    first, last = int(video.frames[0]), int(video.frames[-1])
    return {"frames": [first, last + 1], "step": step, "size": video.size, "people": people}


def outline(pose: Float[np.ndarray, "K 3"], names: Sequence[str]) -> Float[np.ndarray, "P 2"]:
    """The polygon around a person's limbs, trunk and head, in pixels."""
    box = box_of(pose)
    scale = MASK_PX / size_of(pose)
    width, height = (np.ceil((box[2:] - box[:2]) * scale) + 2 * MARGIN_PX).astype(int)
    mask = np.zeros((int(height), int(width)), np.uint8)
    _paint(mask, {
        name: tuple(np.rint((xy - box[:2]) * scale + MARGIN_PX).astype(int).tolist())
        for name, xy, confidence in zip(names, pose[:, :2], pose[:, 2], strict=True)
        if confidence > 0
    })  # fmt: skip
    polygon = _one_contour(mask)
    smooth = cv2.approxPolyDP(polygon, 0.9, True).reshape(-1, 2).astype(float)
    return (smooth - MARGIN_PX) / scale + box[:2]


def _one_contour(mask: UInt8[np.ndarray, "H W"]) -> Any:
    """The outer contour of all that is painted, parts joined where they are nearest."""
    while True:
        contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        if len(contours) == 1:
            return contours[0]
        part = contours[0].reshape(-1, 1, 2)
        others = np.concatenate(contours[1:]).reshape(1, -1, 2)
        distances = np.linalg.norm((part - others).astype(float), axis=-1)
        a, b = np.unravel_index(distances.argmin(), distances.shape)
        ends = tuple(map(int, part[a, 0])), tuple(map(int, others[0, b]))
        cv2.line(mask, *ends, 255, max(2, round(LIMB * MASK_PX)))


def _counts(score: float, best: float, track: PersonTrack) -> bool:
    """Whether somebody is large and long enough in the picture to be chosen."""
    return score > NEGLIGIBLE * best and len(track.frames) > 1


def _paint(mask: UInt8[np.ndarray, "H W"], points: dict[str, tuple[int, int]]) -> None:
    """Paint a body's limbs, trunk and head; points that belong to none of them as dots."""
    thick = max(2, round(LIMB * MASK_PX))
    for point in points.values():
        cv2.circle(mask, point, thick // 2, 255, -1)
    for side in ("left", "right"):
        for limb in LIMBS:
            ends = [points[f"{side}_{part}"] for part in limb if f"{side}_{part}" in points]
            for a, b in pairwise(ends):
                cv2.line(mask, a, b, 255, thick)
    corners = ("left_shoulder", "right_shoulder", "right_hip", "left_hip")
    trunk = np.array([points[c] for c in corners if c in points], np.int32).reshape(-1, 2)
    if len(trunk) >= 2:
        cv2.polylines(mask, [trunk], True, 255, thick)
        cv2.fillConvexPoly(mask, cv2.convexHull(trunk), 255)
    face = [points[p] for p in ("nose", "left_ear", "right_ear", "head") if p in points]
    if face:
        x, y = np.mean(face, axis=0)
        cv2.circle(mask, (round(x), round(y)), round(HEAD * MASK_PX), 255, -1)
        shoulders = [points[c] for c in corners[:2] if c in points]
        for shoulder in shoulders:
            cv2.line(mask, (round(x), round(y)), shoulder, 255, max(2, thick // 2))


def _whole(values: Float[np.ndarray, "..."]) -> list[int]:
    return [round(v) for v in values.ravel().tolist()]

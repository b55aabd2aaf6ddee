"""Replays: the same take shown again, at another speed, cropped, scaled or mirrored.

Two showings of one take have the same keypoints up to one similarity of the picture and a map of
time that only advances, and the same picture of the person along that map. Two performances in
front of one camera have the same background, but neither of these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from imocap_core.verdict.person_size import person_size
from imocap_core.verdict.same_take import (
    moving_frames,
    nearest,
    picture_similarity,
    upsampled,
)

NEAR = 0.0125  # of the person's size: root mean square over the keypoints, median over frames
CENTRE = 0.0045  # of the person's size: distance of the keypoints' centres, median over frames
UNLIKE = 0.05  # as NEAR, of poses about their centres
ALIKE = 0.95  # correlation of the pictures of the person, median over frames
ADVANCING = 0.7  # of the frames lie on one line of time,
ASIDE = 0.1  # of the duration: or so near to it
LEAST_MOVING = 8  # frames
POSITIONS_PER_FRAME = 4
PLAYED = np.geomspace(0.2, 5.0, 57)  # frames of the second a frame of the first
PATCH = 64  # side of the compared pictures of the person
COMPARED = 9  # pictures


@dataclass(frozen=True)
class Replay:
    """Frames of one track that show those of another again.

    rate: frames of the second a frame of the first. frames, repeated: corresponding frames, of the
    first and of the second track. scale, shift, mirrored: x_first = scale x_second + shift, after
    x -> -x where mirrored.
    """

    rate: float
    frames: Int[np.ndarray, " N"]
    repeated: Int[np.ndarray, " N"]
    scale: float
    shift: Float[np.ndarray, "2"]
    mirrored: bool


def repeated_motion(
    first_px: Float[np.ndarray, "T K 2"],
    second_px: Float[np.ndarray, "S K 2"],
    fps: float,
    twins: Sequence[int],
) -> Replay | None:
    """Whether the moving frames of the first track are all in the second one, as far as keypoints
    say; None if not, or where too little moves.

    Args:
        twins: each keypoint's left-right counterpart.
    """
    for mirrored in (False, True):
        second = second_px[:, list(twins)] * [-1.0, 1.0] if mirrored else second_px
        usable = np.isfinite(first_px).all(-1).mean(0) > 0.8
        usable &= np.isfinite(second).all(-1).mean(0) > 0.8
        if usable.sum() < 6:
            continue
        replay = _repeated(first_px[:, usable], second[:, usable], fps, mirrored)
        if replay is not None:
            return replay
    return None


def _repeated(
    a: Float[np.ndarray, "T K 2"], b: Float[np.ndarray, "S K 2"], fps: float, mirrored: bool
) -> Replay | None:
    moving = moving_frames(a, fps)
    complete = np.flatnonzero(np.isfinite(b).all((1, 2)))
    if len(moving) < LEAST_MOVING or len(complete) < LEAST_MOVING:
        return None
    size = person_size(a)
    x, y = a[moving], upsampled(b[complete], POSITIONS_PER_FRAME)
    scale = size / person_size(b)
    index, distance = nearest(x - x.mean(1, keepdims=True), scale * (y - y.mean(1, keepdims=True)))
    if np.median(distance) > UNLIKE * size:
        return None
    shift = np.zeros(2)
    for _ in range(4):
        scale, shift = picture_similarity(y[index], x)
        index, distance = nearest(x, scale * y + shift)
    position = np.interp(index / POSITIONS_PER_FRAME, np.arange(len(complete)), complete)
    rate = _slope(moving, position)
    if rate <= 0:  # it goes back the way it came: the nearest frame may be on the way there
        index, distance = _at_constant_rate(x, scale * y + shift, moving)
        position = np.interp(index / POSITIONS_PER_FRAME, np.arange(len(complete)), complete)
        rate = _slope(moving, position)
    aside = np.linalg.norm((x - scale * y[index] - shift).mean(axis=1), axis=-1)
    if np.median(distance) > NEAR * size or np.median(aside) > CENTRE * size or rate <= 0:
        return None
    repeated = np.rint(position).astype(int)
    return Replay(rate, moving, repeated, scale, shift, mirrored)


def _at_constant_rate(
    x: Float[np.ndarray, "N K 2"], y: Float[np.ndarray, "P K 2"], frames: Int[np.ndarray, " N"]
) -> tuple[Int[np.ndarray, " N"], Float[np.ndarray, " N"]]:
    """The frames of y that x repeats if it is played at one speed, and their distances."""
    flat_x, flat_y = x.reshape(len(x), -1), y.reshape(len(y), -1)
    square = (flat_x**2).sum(1)[:, None] + (flat_y**2).sum(1) - 2 * flat_x @ flat_y.T
    distance = np.sqrt(np.maximum(square, 0.0) / x.shape[1])
    rows, elapsed = np.arange(len(x)), frames - frames[0]
    best, chosen = np.inf, np.zeros(len(x), dtype=int)
    for rate in PLAYED:
        steps = np.rint(POSITIONS_PER_FRAME * rate * elapsed).astype(int)
        begins = np.arange(max(0, len(y) - steps[-1]))
        if len(begins):
            columns = begins[:, None] + steps
            medians = np.median(distance[rows, columns], axis=1)
            if medians.min() < best:
                best, chosen = float(medians.min()), columns[int(medians.argmin())]
    return chosen, distance[rows, chosen]


def _slope(frames: Int[np.ndarray, " N"], position: Float[np.ndarray, " N"]) -> float:
    """Frames of the second a frame of the first (Theil-Sen); 0 where time does not advance."""
    later, risen = np.subtract.outer(frames, frames), np.subtract.outer(position, position)
    apart = later > np.ptp(frames) / 4
    if not apart.any():
        return 0.0
    slope = float(np.median(risen[apart] / later[apart]))
    offset = position - slope * frames
    aside = np.abs(offset - np.median(offset))
    return slope if (aside < ASIDE * slope * np.ptp(frames)).mean() > ADVANCING else 0.0


def compared_pairs(replay: Replay) -> list[tuple[int, int]]:
    """Corresponding frames of both tracks whose pictures are to be compared."""
    rows = np.unique(np.linspace(0, len(replay.frames) - 1, COMPARED).round().astype(int))
    return [(int(replay.frames[row]), int(replay.repeated[row])) for row in rows]


def same_picture(
    first: UInt8[np.ndarray, "H W"],
    second: UInt8[np.ndarray, "H2 W2"],
    box_px: Float[np.ndarray, "4"],
    replay: Replay,
) -> float:
    """Correlation of the first picture in the person's box with the second one brought onto it."""
    x0, y0, x1, y1 = box_px
    zoom = PATCH / max(x1 - x0, y1 - y0, 1.0)
    to_patch = np.array([[zoom, 0, -zoom * x0], [0, zoom, -zoom * y0], [0, 0, 1]])
    sign = -1.0 if replay.mirrored else 1.0
    onto = np.array(
        [[sign * replay.scale, 0, replay.shift[0]], [0, replay.scale, replay.shift[1]], [0, 0, 1]]
    )
    size = (max(8, round(zoom * (x1 - x0))), max(8, round(zoom * (y1 - y0))))
    a, b = (
        cv2.GaussianBlur(cv2.warpAffine(picture, warp[:2], size, flags=cv2.INTER_AREA), (0, 0), 1.5)
        for picture, warp in ((first, to_patch), (second, to_patch @ onto))
    )
    a, b = (x.astype(float) - x.mean() for x in (a, b))
    spread = float(np.sqrt((a * a).sum() * (b * b).sum()))
    return float((a * b).sum()) / spread if spread > 0 else 0.0

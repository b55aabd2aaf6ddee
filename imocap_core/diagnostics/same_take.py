"""One recording given twice: re-timed, cropped or mirrored.

Two recordings of one camera's picture have the same keypoints up to one similarity of the picture
(crop, scale, reflection) and a map of time, which is a clock's: a constant offset and rate.
Performances that differ, from the very same viewpoint too, do not. A detector's noise on a copy
that was coded again is as large as the difference between the most alike performances (two walks of
one person, put in place as well as possible), but nobody repeats a movement to the frame. So what
agrees more closely than performances do, or as well and by the clock, is certain; the rest is a
suspicion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from jaxtyping import Float, Int

from imocap_core.artifacts.schemas import VideoKeypoints
from imocap_core.diagnostics.contradictions import TWINS, limbs_px, person_size
from imocap_core.diagnostics.findings import Finding, listed
from imocap_core.sequences import theil_sen_slope

NEAR = 0.015  # of the person's size: root mean square over the keypoints
NEAR_SHARE = 0.7  # of the moving frames that must be as near
UNLIKE = 0.05  # of the person's size: poses about their centres, median; above it nothing is alike
CERTAIN = 0.005  # as NEAR: the most alike performances differ by more
CLOCK_FRAMES, CLOCK_SHARE = 1.0, 0.75  # off one offset and rate; of the frames that are near
CLOCK_SPAN_S = 2.0  # over which the clocks must agree
CENTRE = 0.003  # of the person's size: median distance of the keypoints' centres
MOVING = 0.015  # of the person's size within MOVING_S
MOVING_S = 0.2
LEAST_MOVING_S = 0.5
LEAST_JOINTS = 6
POSITIONS_PER_FRAME = 4
COMPARED = 300  # frames of the first video, at most


@dataclass(frozen=True)
class SameTake:
    """Moving frames of the one repeat those of the other.

    rate: frames of the second a frame of the first; certain: no two performances are as alike.
    """

    rate: float
    mirrored: bool
    certain: bool


def same_take(
    first_px: Float[np.ndarray, "T K 2"],
    second_px: Float[np.ndarray, "S K 2"],
    fps: tuple[float, float],
    twins: Sequence[int],
) -> SameTake | None:
    """Whether one video shows the same recording as (a part of) the other; None if not.

    None too where nothing moves: then nothing tells recordings apart.

    Args:
        first_px, second_px: the same keypoints of both, NaN where not detected.
        twins: each keypoint's left-right counterpart.
    """
    match = _part_of(first_px, second_px, fps[0], twins)
    if match is not None:
        return match
    match = _part_of(second_px, first_px, fps[1], twins)
    return None if match is None else replace(match, rate=1 / match.rate)


def _part_of(
    first_px: Float[np.ndarray, "T K 2"],
    second_px: Float[np.ndarray, "S K 2"],
    fps: float,
    twins: Sequence[int],
) -> SameTake | None:
    """Whether the first video's moving frames are all in the second, as it is or mirrored."""
    usable = [np.isfinite(x).all(-1).mean(0) > 0.8 for x in (first_px, second_px)]
    for mirrored in (False, True):
        a = first_px[:, list(twins)] * np.array([-1.0, 1.0]) if mirrored else first_px
        visible = (usable[0][list(twins)] if mirrored else usable[0]) & usable[1]
        if visible.sum() < LEAST_JOINTS:
            continue
        match = _repeated(a[:, visible], second_px[:, visible], fps, mirrored)
        if match is not None:
            return match
    return None


def _repeated(
    a: Float[np.ndarray, "T K 2"], b: Float[np.ndarray, "S K 2"], fps: float, mirrored: bool
) -> SameTake | None:
    moving = moving_frames(a, fps)
    complete = np.flatnonzero(np.isfinite(b).all((1, 2)))
    b = b[complete]
    if len(moving) < max(8.0, LEAST_MOVING_S * fps) or len(b) < 8:
        return None
    frames = moving[np.unique(np.linspace(0, len(moving) - 1, COMPARED).round().astype(int))]
    size = person_size(a)
    x, y = a[frames], upsampled(b, POSITIONS_PER_FRAME)
    # poses about their centres find the frames, whatever the crop; then one similarity for all
    scale_guess = size / person_size(b)
    index, distance = nearest(_centred(x), scale_guess * _centred(y))
    if np.median(distance) > UNLIKE * size:
        return None
    for _ in range(3):
        scale, shift = picture_similarity(y[index], x)
        index, distance = nearest(x, scale * y + shift)
    near = distance < NEAR * size
    centres = np.linalg.norm((x - scale * y[index] - shift).mean(1), axis=-1)
    if near.mean() < NEAR_SHARE or np.median(centres) > CENTRE * size:
        return None
    positions = np.interp(index[near] / POSITIONS_PER_FRAME, np.arange(len(b)), complete)
    rate = theil_sen_slope(frames[near], positions)
    if rate <= 0:
        return None
    closer = (distance < CERTAIN * size).mean() >= NEAR_SHARE
    certain = bool(closer or _by_the_clock(frames[near], positions, rate, fps))
    return SameTake(rate, mirrored, certain)


def moving_frames(xy_px: Float[np.ndarray, "T K 2"], fps: float) -> Int[np.ndarray, " _"]:
    """Indices of complete frames about which the keypoints move."""
    step = max(1, round(MOVING_S * fps / 2))
    if len(xy_px) <= 2 * step:
        return np.zeros(0, dtype=int)
    moved = np.linalg.norm(xy_px[2 * step :] - xy_px[: -2 * step], axis=-1).mean(-1)
    complete = np.isfinite(xy_px).all((1, 2))[step:-step]
    return step + np.flatnonzero(complete & (np.nan_to_num(moved) > MOVING * person_size(xy_px)))


def upsampled(b: Float[np.ndarray, "S K 2"], times: int) -> Float[np.ndarray, "_ K 2"]:
    """Frames with `times` - 1 interpolated ones between two."""
    share = (np.arange(times) / times)[None, :, None, None]
    between = (1 - share) * b[:-1, None] + share * b[1:, None]
    return np.concatenate([between.reshape(-1, *b.shape[1:]), b[-1:]])


def nearest(
    x: Float[np.ndarray, "N K 2"], y: Float[np.ndarray, "P K 2"]
) -> tuple[Int[np.ndarray, " N"], Float[np.ndarray, " N"]]:
    """The nearest of y for each of x, and its root-mean-square distance over the keypoints."""
    flat_x, flat_y = x.reshape(len(x), -1), y.reshape(len(y), -1)
    square = (flat_x**2).sum(1)[:, None] + (flat_y**2).sum(1) - 2 * flat_x @ flat_y.T
    index = square.argmin(1)
    distance = np.linalg.norm(flat_x - flat_y[index], axis=1) / np.sqrt(x.shape[1])
    return index, distance


def picture_similarity(
    y: Float[np.ndarray, "N K 2"], x: Float[np.ndarray, "N K 2"]
) -> tuple[float, Float[np.ndarray, "2"]]:
    """Scale and shift with x = scale y + shift, by least squares over the better half of frames."""
    scale, shift = _similarity(y, x)
    error = np.linalg.norm(scale * y + shift - x, axis=-1).mean(-1)
    better = error <= np.median(error)
    return _similarity(y[better], x[better])


def _similarity(y: np.ndarray, x: np.ndarray) -> tuple[float, np.ndarray]:
    mean_y, mean_x = y.mean((0, 1)), x.mean((0, 1))
    spread = ((y - mean_y) ** 2).sum()
    scale = float(((y - mean_y) * (x - mean_x)).sum() / spread) if spread > 0 else 1.0
    return scale, mean_x - scale * mean_y


def _centred(x: Float[np.ndarray, "N K 2"]) -> Float[np.ndarray, "N K 2"]:
    return x - x.mean(1, keepdims=True)


def _by_the_clock(
    frames: Int[np.ndarray, " N"], positions: Float[np.ndarray, " N"], rate: float, fps: float
) -> bool:
    """Whether most positions lie within a frame of one offset and rate, for long enough."""
    early = positions - rate * frames
    off = np.abs(early - np.median(early)) <= CLOCK_FRAMES * max(1.0, rate)
    return bool(off.mean() >= CLOCK_SHARE and np.ptp(frames[off]) >= CLOCK_SPAN_S * fps)


def take_findings(videos: Sequence[VideoKeypoints]) -> list[Finding]:
    """Videos that repeat another video's recording, and those that may."""
    findings = []
    repeating: set[str] = set()
    for first, second in combinations(videos, 2):
        if second.id in repeating:
            continue
        fps = (second.fps, first.fps)
        take = same_take(limbs_px(second), limbs_px(first), fps, TWINS)
        if take is None:
            continue
        if take.certain:
            repeating.add(second.id)
        findings.append(_finding(second, first, take))
    return findings


def said_first(timing: str, findings: Sequence[Finding], count: int) -> str:
    """The first sentence of a verdict, which begins with recordings that are there twice.

    Args:
        timing: what it says otherwise; findings: `take_findings` among them; count: of all videos.
    """
    takes = [f for f in findings if f.kind == "same take"]
    if not takes:
        return timing
    copies, views = listed([f"{f.video} is {f.brief}" for f in takes]), count - len(takes)
    if views == 1:
        return f"{copies}: {count} videos are one view, and nothing checks the result."
    timing = timing.replace("The timing", "the timing", 1)
    return f"{copies}, so {count} videos are {views} views; {timing}"


def _finding(video: VideoKeypoints, other: VideoKeypoints, take: SameTake) -> Finding:
    speed = take.rate * video.fps / other.fps
    how = [] if 0.97 < speed < 1.03 else [f"played at {speed:.2g} times its speed"]
    how += ["mirrored"] if take.mirrored else []
    again = f" ({', '.join(how)})" if how else ""
    if not take.certain:
        return Finding(
            "remark",
            video.id,
            f"may be the same recording as {other.id}{again}, or a performance very much like it, "
            "from the same place",
            f"may be the same recording as {other.id}",
            f"if it is a copy, remove it or {other.id} from action.yaml: it adds no view",
        )
    return Finding(
        "same take",
        video.id,
        f"the same recording as {other.id}{again}: it adds no view, and what both agree on is no "
        "confirmation",
        f"the same recording as {other.id}",
        f"remove it or {other.id} from action.yaml",
    )

"""One video in the viewer, and its source frames as a small video."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from imocap_core.artifacts.schemas import Keypoints, SyncSummary, Uncertainty, VideoKeypoints
from imocap_core.camera.projection import Lens, project_camera
from imocap_core.conventions import SMPL_PARENTS
from imocap_core.figures.style import color_of
from imocap_core.io.video import WEBM_FPS, encode_webm, read_rgb_of
from imocap_core.result.video import VideoCamera
from imocap_core.viewer.html import Block, Entry

Image = UInt8[np.ndarray, "H W 3"]
Window = tuple[int, int, int, int]  # x, y, width, height in pixels

PICTURES = (1000, 448)  # most of all videos together; pixels of the longer side
SMALL = (350, 320)  # the same on a phone, and before a run's end
_CRF, _KEY_EVERY = 36, 16  # VP9's quality; a seek decodes so many pictures at most
_MARGIN = 0.22  # beside the performer's outermost positions, share of their span
_ASPECTS = (0.75, 1.6)  # width / height of the part that is shown, where the picture allows


def stride(lengths: list[int], most: int = PICTURES[0]) -> int:
    """One of how many frames is shown, so that no more than about `most` are."""
    return max(1, -(-sum(lengths) // most))


def windows(
    boxes_px: Sequence[Float[np.ndarray, "_ 4"]], sizes: Sequence[tuple[int, int]]
) -> list[Window]:
    """For each video the part of its pictures in which the performer always is, of one aspect
    where the pictures allow.

    boxes_px: per video (T, 4) x0 y0 x1 y1 of every frame, NaN where unseen; sizes: width, height.
    """
    reaches = [_reach(boxes, size) for boxes, size in zip(boxes_px, sizes, strict=True)]
    aspects = [(x1 - x0) / (y1 - y0) for x0, y0, x1, y1 in reaches]
    aspect = float(np.clip(np.median(aspects), *_ASPECTS))
    parts = []
    for reach, size in zip(reaches, sizes, strict=True):
        low, high = reach[:2], reach[2:]
        sides = np.maximum(high - low, [(high - low)[1] * aspect, (high - low)[0] / aspect])
        sides = np.minimum(np.round(sides), size)
        corner = np.clip(np.round((low + high - sides) / 2), 0, np.array(size) - sides)
        parts.append((int(corner[0]), int(corner[1]), int(sides[0]), int(sides[1])))
    return parts


def _reach(boxes_px: Float[np.ndarray, "T 4"], size: tuple[int, int]) -> Float[np.ndarray, " 4"]:
    """x0 y0 x1 y1 about all boxes with a margin; the whole picture where there is none."""
    visible = boxes_px[np.isfinite(boxes_px).all(axis=1)]
    if not len(visible):
        return np.array([0.0, 0.0, *size])
    low, high = visible[:, :2].min(axis=0), visible[:, 2:].max(axis=0)
    margin = _MARGIN * float((high - low).max()) + 1
    return np.concatenate([low - margin, high + margin])


def picture_entry(
    block: Block,
    file: Path,
    frames: Int[np.ndarray, " T"],
    every: int,
    part: Window,
    lens: Lens | None = None,
    longest_px: int = PICTURES[1],
) -> dict[str, Any] | None:
    """Pictures of every `every`-th used frame; None when the file ends before the first.

    frames (T,): source frame numbers. part: of each that is shown. lens: its distortion is taken
    out. A frame that the file lacks repeats the one before. ValueError when the file is no readable
    video.
    """
    shows = cutter(part, lens)
    wanted = frames[::every].tolist()
    pictures = read_rgb_of(file, set(wanted))
    shown = ((number, shrunk(shows(picture), longest_px)) for number, picture in pictures)
    first = next(shown, None)
    if first is None:
        return None
    stream = encode_webm(_repeated(chain([first], shown), wanted), crf=_CRF, key_every=_KEY_EVERY)
    return {
        "every": every,
        "size": list(stream.size),
        "rate": WEBM_FPS,
        "packets": block.add(stream.packets, "u4"),
        "keys": block.add(stream.keys, "u1"),
        "bytes": block.add(np.frombuffer(stream.content, np.uint8), "u1"),
    }


def _repeated(pictures: Iterator[tuple[int, Image]], wanted: Sequence[int]) -> Iterator[Image]:
    """The picture of each wanted frame; of a missing one that before it, or the first of all."""
    coming = next(pictures, None)
    shown = coming
    for number in wanted:
        while coming is not None and coming[0] <= number:
            shown, coming = coming, next(pictures, None)
        if shown is not None:
            yield shown[1]


def cutter(part: Window, lens: Lens | None) -> Callable[[Image], Image]:
    """Cuts a part out of pictures, as a pinhole camera would show it; black beyond their border."""
    x, y, width, height = part
    if lens is None:
        return lambda picture: picture[y : y + height, x : x + width]
    grid = np.stack(np.meshgrid(np.arange(x, x + width), np.arange(y, y + height)), axis=-1)
    source = lens.distorted(grid.astype(np.float64)).astype(np.float32)
    x_map, y_map = source[..., 0], source[..., 1]
    return lambda picture: np.asarray(cv2.remap(picture, x_map, y_map, cv2.INTER_LINEAR), np.uint8)


def shrunk(picture: Image, longest_px: int) -> Image:
    """A picture whose longer side is at most `longest_px`."""
    scale = min(1.0, longest_px / max(picture.shape[:2]))
    size = (max(2, round(scale * picture.shape[1])), max(2, round(scale * picture.shape[0])))
    if scale == 1 and size == picture.shape[1::-1]:
        return picture
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)


UNKNOWN_MM = 65535  # in place of a standard deviation that is not known
_PIXEL_RANGE = 16000  # of 16-bit numbers for the longer side of a picture: two pictures each way


def identity_entry(block: Block, keypoints: Keypoints, i: int, sync: SyncSummary) -> dict[str, Any]:
    """Name, role and colour of video i, and its place on the common axis."""
    video = keypoints.videos[i]
    matches = sync.map_of(video.id)
    excluded = video.id in sync.excluded
    roles = [("reference", video.id == sync.reference), ("another action", excluded)]
    roles.append(("mirrored", video.id in sync.mirrored))
    matched = np.isfinite(matches.reference_frame)
    confidence = np.where(matched, np.nan_to_num(matches.confidence), 0.0)
    return {
        "id": video.id,
        "role": ", ".join(role for role, applies in roles if applies),
        "color": color_of(sync.ids, video.id),
        "fps": video.fps,
        "size": list(video.size),
        "excluded": excluded,
        "frames": block.add(video.frames, "i4"),
        "phase": block.add(phase_of(sync, keypoints, i), "f4"),
        "confidence": block.add(np.round(255 * np.clip(confidence, 0, 1)), "u1"),
    }


def phase_of(sync: SyncSummary, keypoints: Keypoints, i: int) -> Float[np.ndarray, " T"]:
    """Seconds of the reference (T,) of every frame of video i, never falling.

    A frame of unknown phase lies between its neighbours, or beyond them at the video's own pace; a
    video without any phase begins at 0.
    """
    video = keypoints.videos[i]
    clock_s = np.arange(len(video.frames)) / video.fps
    fps = next(v.fps for v in keypoints.videos if v.id == sync.reference)
    phase = sync.phases.get(video.id, sync.map_of(video.id).reference_frame / fps)
    placed = np.flatnonzero(np.isfinite(phase))
    if not len(placed):
        return clock_s
    first, last = placed[0], placed[-1]
    filled = np.interp(np.arange(len(phase)), placed, phase[placed])
    filled[:first] += clock_s[:first] - clock_s[first]
    filled[last:] += clock_s[last:] - clock_s[last]
    return np.asarray(np.maximum.accumulate(filled))


def timeline_entry(keypoints: Keypoints, sync: SyncSummary) -> dict[str, float]:
    """From the first frame of any synchronised video to the last; a step is a reference frame.

    shared: the first moment at which all of them have a matched frame; else that has most of them.
    """
    used = [i for i, v in enumerate(keypoints.videos) if v.id not in sync.excluded]
    phases = [phase_of(sync, keypoints, i).astype(np.float32) for i in used]
    fps = next(v.fps for v in keypoints.videos if v.id == sync.reference)
    first, last = min(float(p[0]) for p in phases), max(float(p[-1]) for p in phases)
    matched = [np.isfinite(sync.map_of(keypoints.videos[i].id).reference_frame) for i in used]
    shared = first_shared([p[m] for p, m in zip(phases, matched, strict=True) if m.any()], first)
    return {"first": first, "last": last, "step": 1 / fps, "shared": shared}


def first_shared(moments: Sequence[Float[np.ndarray, " _"]], otherwise: float) -> float:
    """The first moment that lies within the most of some spans, each from the first to the last of
    its ascending moments; `otherwise` without any."""
    starts = sorted(float(m[0]) for m in moments)
    spans = [(float(m[0]), float(m[-1])) for m in moments]
    return max(
        starts, key=lambda s: sum(low <= s <= high for low, high in spans), default=otherwise
    )


def camera_entry(block: Block, camera: VideoCamera) -> dict[str, Any]:
    """Its intrinsics and position; its axes (right, down, ahead as columns) and zoom per frame."""
    axes = camera.R.T @ camera.R_first_from_frame
    static = np.allclose(axes, axes[:1], atol=1e-9)
    fx, fy, cx, cy = camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]
    lens = {"fx": float(fx), "fy": float(fy), "cx": float(cx), "cy": float(cy)}
    return {
        **lens,
        "centre": camera.centre.tolist(),
        "centres": None if camera.path_m is None else block.add(camera.centre_per_frame, "f4"),
        "axes": block.add(axes[:1] if static else axes, "f4"),
        "zoom": block.add(camera.zoom, "f4"),
    }


def _pixels(block: Block, xy_px: Float[np.ndarray, "T K 2"], size: tuple[int, int]) -> Entry:
    unit = _PIXEL_RANGE / max(size)
    whole = np.clip(np.round(np.nan_to_num(xy_px) * unit), -32767, 32767)
    return {"xy": block.add(whole, "i2"), "unit": unit, "count": xy_px.shape[1]}


def detected_entry(block: Block, video: VideoKeypoints, lens: Lens | None) -> dict[str, Any]:
    """The detected keypoints of every frame, without the lens's distortion; a confidence of 0 where
    there is none."""
    xy_px = video.xy_px if lens is None else lens.undistorted(video.xy_px)
    visible = np.isfinite(video.xy_px).all(axis=-1)
    confidence = np.where(visible, np.clip(np.nan_to_num(video.confidence), 0, 1), 0)
    sure = block.add(np.ceil(255 * confidence), "u1")
    return {**_pixels(block, xy_px, video.size), "sure": sure}


def uncertainty_entry(block: Block, claimed: Uncertainty | None, video: str) -> Entry | None:
    """The standard deviation of each of SMPL's joints in every frame, whole mm; `UNKNOWN_MM` where
    it is not known. None without any."""
    for deviations in claimed.videos if claimed is not None else ():
        if deviations.id == video:
            mm = np.minimum(deviations.sigma_mm, UNKNOWN_MM - 1)
            return block.add(np.where(np.isfinite(mm), np.round(mm), UNKNOWN_MM), "u2")
    return None


def skeleton_entry(
    block: Block,
    joints: Float[np.ndarray, "T 24 3"],
    camera: VideoCamera,
    K: Float[np.ndarray, "3 3"],
) -> dict[str, Any]:
    """SMPL's joints (T, 24, 3), given in the first frame's axes and relative to the camera's place,
    in the pixels of every frame.

    K: intrinsics of the first frame, which need not be the camera's.
    """
    in_frame = joints @ camera.R_first_from_frame  # R^T x
    middle = K[:2, 2]
    xy_px = middle + camera.zoom[:, None, None] * (project_camera(in_frame, K) - middle)
    return {**_pixels(block, xy_px, camera.size), "parents": list(SMPL_PARENTS)}

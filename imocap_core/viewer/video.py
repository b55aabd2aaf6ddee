"""One video in the viewer: its identity, its camera, and the detections in its pictures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.artifacts.schemas import Keypoints, SyncSummary, Uncertainty, VideoKeypoints
from imocap_core.camera.lens import Lens
from imocap_core.camera.projection import project_camera
from imocap_core.conventions import SMPL_JOINTS, SMPL_PARENTS
from imocap_core.figures.style import color_of
from imocap_core.result.camera import VideoCamera
from imocap_core.viewer.block import Block, Entry

UNKNOWN_MM = 65535  # in place of a standard deviation that is not known
PIXEL_RANGE = 16000  # of 16-bit numbers for the longer side of a picture: two pictures each way


def identity_entry(block: Block, keypoints: Keypoints, i: int, sync: SyncSummary) -> dict[str, Any]:
    """Name, role and colour of video i, and its place on the common axis."""
    video = keypoints.videos[i]
    matches = next(m for m in sync.maps if m.id == video.id)
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
    if sync.trust is not None:
        phase = next(v for v in sync.trust.videos if v.id == video.id).phase_s
    else:
        fps = next(v.fps for v in keypoints.videos if v.id == sync.reference)
        phase = next(m for m in sync.maps if m.id == video.id).reference_frame / fps
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
    matched = [
        np.isfinite(next(m for m in sync.maps if m.id == keypoints.videos[i].id).reference_frame)
        for i in used
    ]
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


def _pixels(
    block: Block, xy_px: Float[np.ndarray, "T K 2"], size: tuple[int, int]
) -> tuple[Entry, float]:
    unit = PIXEL_RANGE / max(size)
    whole = np.clip(np.round(np.nan_to_num(xy_px) * unit), -32767, 32767)
    return block.add(whole, "i2"), unit


def detected_entry(block: Block, video: VideoKeypoints, lens: Lens | None) -> dict[str, Any]:
    """The detected keypoints of every frame, without the lens's distortion; a confidence of 0 where
    there is none."""
    xy_px = video.xy_px if lens is None else lens.undistorted(video.xy_px)
    xy, unit = _pixels(block, xy_px, video.size)
    visible = np.isfinite(video.xy_px).all(axis=-1)
    confidence = np.where(visible, np.clip(np.nan_to_num(video.confidence), 0, 1), 0)
    sure = block.add(np.ceil(255 * confidence), "u1")
    return {"xy": xy, "unit": unit, "count": video.xy_px.shape[1], "sure": sure}


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
    xy, unit = _pixels(block, xy_px, camera.size)
    return {"xy": xy, "unit": unit, "count": len(SMPL_JOINTS), "parents": list(SMPL_PARENTS)}

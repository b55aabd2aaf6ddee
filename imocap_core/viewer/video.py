"""One video in the viewer: who it is, its camera, and what was found in its pictures."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from imocap_core.artifacts.schemas import (
    Camera,
    Keypoints,
    SyncSummary,
    VideoCameraMotion,
    VideoKeypoints,
)
from imocap_core.camera.projection import project_camera
from imocap_core.camera.world import Extrinsics, GroundAlignment, align_camera_to_ground
from imocap_core.conventions import SMPL_JOINTS, SMPL_PARENTS
from imocap_core.figures.style import color_of
from imocap_core.viewer.block import Block, Entry

Array = NDArray[np.float64]

PIXEL_RANGE = 16000  # of 16-bit numbers for the longer side of a picture: two pictures each way


def identity_entry(block: Block, keypoints: Keypoints, i: int, sync: SyncSummary) -> dict[str, Any]:
    """Who video i is and where it stands on the common axis."""
    seen = keypoints.videos[i]
    found = next(m for m in sync.maps if m.id == seen.id)
    excluded = seen.id in sync.excluded
    roles = [("reference", seen.id == sync.reference), ("another action", excluded)]
    roles.append(("mirrored", seen.id in sync.mirrored))
    sure = np.where(np.isfinite(found.reference_frame), np.nan_to_num(found.confidence), 0.0)
    return {
        "id": seen.id,
        "role": ", ".join(role for role, so in roles if so),
        "color": color_of(sync.ids, seen.id),
        "fps": seen.fps,
        "size": list(seen.size),
        "excluded": excluded,
        "frames": block.add(seen.frames, "i4"),
        "phase": block.add(phase_of(sync, keypoints, i), "f4"),
        "confidence": block.add(np.round(255 * np.clip(sure, 0, 1)), "u1"),
    }


def phase_of(sync: SyncSummary, keypoints: Keypoints, i: int) -> Array:
    """Seconds of the reference (T,) of every frame of video i, never falling.

    A frame whose phase is not known lies between its neighbours, or beyond them at the video's own
    pace; a video without any begins at 0.
    """
    seen = keypoints.videos[i]
    own = np.arange(len(seen.frames)) / seen.fps
    if sync.trust is not None:
        phase = next(v for v in sync.trust.videos if v.id == seen.id).phase_s
    else:
        fps = next(v.fps for v in keypoints.videos if v.id == sync.reference)
        phase = next(m for m in sync.maps if m.id == seen.id).reference_frame / fps
    known = np.flatnonzero(np.isfinite(phase))
    if not len(known):
        return own
    first, last = known[0], known[-1]
    filled = np.interp(np.arange(len(phase)), known, phase[known])
    filled[:first] += own[:first] - own[first]
    filled[last:] += own[last:] - own[last]
    return np.asarray(np.maximum.accumulate(filled))


def timeline_entry(keypoints: Keypoints, sync: SyncSummary) -> dict[str, float]:
    """From the first frame of any synchronised video to the last; a step is a reference frame."""
    kept = [i for i, v in enumerate(keypoints.videos) if v.id not in sync.excluded]
    phases = [phase_of(sync, keypoints, i).astype(np.float32) for i in kept]
    fps = next(v.fps for v in keypoints.videos if v.id == sync.reference)
    first, last = min(float(p[0]) for p in phases), max(float(p[-1]) for p in phases)
    return {"first": first, "last": last, "step": 1 / fps}


def camera_entry(
    block: Block, camera: Camera, turned: VideoCameraMotion, level: GroundAlignment
) -> dict[str, Any]:
    """Its lens and place; its axes (right, down, ahead as columns) and zoom in every frame."""
    pose = align_camera_to_ground(Extrinsics(camera.R, camera.t), level)
    axes = pose.R.T @ turned.R_first_from_frame
    still = np.allclose(axes, axes[:1], atol=1e-9)
    fx, fy, cx, cy = camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]
    lens = {"fx": float(fx), "fy": float(fy), "cx": float(cx), "cy": float(cy)}
    centre = (-pose.R.T @ pose.t).tolist()
    return {
        **lens,
        "centre": centre,
        "axes": block.add(axes[:1] if still else axes, "f4"),
        "zoom": block.add(turned.zoom, "f4"),
    }


def _pixels(block: Block, xy_px: Array, size: tuple[int, int]) -> tuple[Entry, float]:
    unit = PIXEL_RANGE / max(size)
    whole = np.clip(np.round(np.nan_to_num(xy_px) * unit), -32767, 32767)
    return block.add(whole, "i2"), unit


def detected_entry(block: Block, seen: VideoKeypoints) -> dict[str, Any]:
    found, unit = _pixels(block, seen.xy_px, seen.size)
    known = np.isfinite(seen.xy_px).all(axis=-1)
    sure = np.where(known, np.clip(np.nan_to_num(seen.confidence), 0, 1), 0)
    count = seen.xy_px.shape[1]
    return {"xy": found, "unit": unit, "count": count, "sure": block.add(np.ceil(255 * sure), "u1")}


def skeleton_entry(
    block: Block, joints: Array, turned: VideoCameraMotion, K: Array, size: tuple[int, int]
) -> dict[str, Any]:
    """SMPL's joints (T, 24, 3), given in the first frame's axes, in the pixels of every frame."""
    in_frame = joints @ turned.R_first_from_frame  # R^T x
    middle = K[:2, 2]
    xy = middle + turned.zoom[:, None, None] * (project_camera(in_frame, K) - middle)
    found, unit = _pixels(block, xy, size)
    return {"xy": found, "unit": unit, "count": len(SMPL_JOINTS), "parents": list(SMPL_PARENTS)}

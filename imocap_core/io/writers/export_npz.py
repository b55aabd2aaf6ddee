"""`imocap export --format npz`: one npz a video, sync.csv and cameras.json.

SMPL's own convention (global orientation about the pelvis, trans as in smplx), metres, radians.
`trans`, `poses`, `betas`, `gender` and `mocap_framerate` are named as in AMASS. The files hold the
same bytes whenever they hold the same values.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ExportedHands:
    """What `<id>.npz` holds besides where keypoints had hands; left, right."""

    poses_smplh: Array  # (T, 156) axis-angle radians: 22 joints of the body, 15 a hand
    points: Array  # (T, 2, 21, 3) metres, OpenPose's points
    seen: NDArray[np.bool_]  # (T, 2)


@dataclass(frozen=True)
class ExportedVideo:
    """What `<id>.npz` holds, all in one world."""

    id: str
    poses: Array  # (T, 72) axis-angle radians
    betas: Array  # (10,)
    trans: Array  # (T, 3) metres
    joints: Array  # (T, 24, 3) metres
    joint_names: tuple[str, ...]
    fps: float
    size: tuple[int, int]
    frames: NDArray[np.int64] | Array  # source frame numbers; fractional on the common timeline
    K: Array
    R: Array  # camera from world
    t: Array  # metres
    model: str  # name and digest of the body model
    up_axis: str
    hands: ExportedHands | None = None
    inside: NDArray[np.bool_] | None = None  # (T,) on the common timeline: the video shows it
    phase_s: Array | None = None  # (T,) on the common timeline: seconds of the reference


def write_video(folder: Path, video: ExportedVideo) -> Path:
    """Write folder/<id>.npz and return its path."""
    file = folder / f"{video.id}.npz"
    more: dict[str, Any] = {}
    if video.hands is not None:
        more = {
            "poses_smplh": video.hands.poses_smplh,
            "hand_points": video.hands.points,
            "hand_seen": video.hands.seen,
        }
    if video.inside is not None and video.phase_s is not None:
        more |= {"inside": video.inside, "phase_s": video.phase_s}
    np.savez(
        file,
        poses=video.poses,
        betas=video.betas,
        trans=video.trans,
        joints=video.joints,
        joint_names=np.array(video.joint_names),
        gender=np.array("neutral"),
        fps=np.float64(video.fps),
        mocap_framerate=np.float64(video.fps),
        frames=video.frames,
        K=video.K,
        R=video.R,
        t=video.t,
        model=np.array(video.model),
        up_axis=np.array(video.up_axis),
        **more,
    )
    return file


def write_cameras(folder: Path, videos: list[ExportedVideo], reference: str) -> Path:
    """Write folder/cameras.json and return its path."""
    file = folder / "cameras.json"
    content = {
        "reference": reference,
        "convention": "x_cam = R x_world + t, metres; x right, y down, z forward; K in pixels",
        "up_axis": videos[0].up_axis,
        "cameras": {
            v.id: {"K": v.K.tolist(), "R": v.R.tolist(), "t": v.t.tolist(), "size": list(v.size)}
            for v in videos
        },
    }
    file.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    return file


def write_sync(
    folder: Path,
    frames: Mapping[str, NDArray[np.int64]],
    maps: Mapping[str, tuple[Array, Array]],
    reference: str,
    phases: Mapping[str, Array] | None = None,
) -> Path:
    """Write folder/sync.csv and return its path.

    Args:
        frames: per video, the source frame numbers (T,) of its used frames.
        maps: per video, the index (T,) into the reference's used frames (fractional, NaN where
            unmatched) and the confidence (T,).
        reference: the video that the others are matched to; it gets no rows.
        phases: per video, its frames (T,) on the common time axis, seconds of the reference, NaN
            where they have no place on it; the column phase_s.
    """
    file = folder / "sync.csv"
    positions = np.arange(len(frames[reference]), dtype=np.float64)
    with file.open("w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(["video", "frame", "reference_frame", "confidence", "phase_s"])
        for video, (index, confidence) in maps.items():
            if video == reference:
                continue
            matched = np.interp(index, positions, frames[reference])
            phase = np.full(len(index), np.nan) if phases is None else phases[video]
            for row in zip(frames[video], matched, confidence, phase, strict=True):
                frame, at, sure, phase_s = row
                rows.writerow([video, frame, _number(at, 3), _number(sure, 3), _number(phase_s, 4)])
    return file


def _number(value: float, decimals: int) -> str:
    return "" if np.isnan(value) else f"{value:.{decimals}f}"

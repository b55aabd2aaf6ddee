"""TCC on an action: keypoints in, the same summary as that of the `sync` stage out."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from benchmarks.tcc import (
    FRAMES,
    POSES,
    TccSettings,
    align_by_tcc,
    frame_clip,
    person_crop,
    pose_clip,
)
from benchmarks.tcc.clips import TccClip, person_squares
from imocap_core.artifacts.schemas import Keypoints, SyncMap, VideoKeypoints
from imocap_core.artifacts.schemas.sync_schemas import SyncSummary
from imocap_core.body.layouts import layout_names
from imocap_core.io.video import read_gray

TccSource = Literal["poses", "frames"]


def tcc_sync(
    keypoints: Keypoints,
    *,
    reference: str,
    seed: int,
    source: TccSource = "poses",
    folder: Path | None = None,
    settings: TccSettings | None = None,
    device: str = "cpu",
) -> SyncSummary:
    """Train TCC on an action's clips and align them to the reference video (an id).

    `source`: 2D poses, or the video frames, whose files lie below the action's `folder`.
    `settings`: those of the source when None. ValueError when the source gives no clip of a video.
    """
    ids = [video.id for video in keypoints.videos]
    if reference not in ids:
        raise ValueError(f"reference: expected one of {', '.join(ids)}, got {reference!r}")
    clips = [clip_of(video, source, folder) for video in keypoints.videos]
    chosen = settings or (POSES if source == "poses" else FRAMES)
    alignment = align_by_tcc(
        clips,
        [video.fps for video in keypoints.videos],
        chosen,
        reference=ids.index(reference),
        seed=seed,
        device=device,
    )
    first, last = alignment.losses[0], alignment.losses[-1]
    return SyncSummary(
        reference=reference,
        ids=ids,
        lengths=[len(clip) for clip in clips],
        maps=[
            SyncMap(id=i, reference_frame=frame, confidence=confidence)
            for i, frame, confidence in zip(
                ids, alignment.reference_frame, alignment.confidence, strict=True
            )
        ],
        method=f"TCC on {source}",
        centrality=np.array([float(i == reference) for i in ids]),
        status=f"{chosen.steps} steps, loss {first:.3f} to {last:.3f}",
    )


def clip_of(video: VideoKeypoints, source: TccSource, folder: Path | None = None) -> TccClip:
    """The encoder's input of one video."""
    if source == "poses":
        return pose_clip(video.xy_px, video.confidence, hip_columns(video.layout))
    if folder is None or video.video is None:
        raise ValueError(f"{video.id}: TCC on frames needs the video file and its action's folder")
    squares = dict(zip(video.frames.tolist(), person_squares(video.person_box_px), strict=True))
    first, stop = int(video.frames[0]), int(video.frames[-1]) + 1
    pictures = read_gray(folder / video.video, first, stop)
    return frame_clip([person_crop(p, squares[t]) for t, p in pictures if t in squares])


def hip_columns(layout: str) -> list[int]:
    """The columns of a layout's hips; ValueError when it has none."""
    names = layout_names(layout)
    columns = [names.index(name) for name in ("left_hip", "right_hip") if name in names]
    if not columns:
        raise ValueError(f"layout {layout}: TCC on poses needs the hips, which it does not have")
    return columns

"""TCC on an action: keypoints in, the same summary as that of the `sync` stage out."""

from __future__ import annotations

import numpy as np

from benchmarks.tcc import POSES, TccSettings, align_by_tcc, pose_clip
from imocap_core.artifacts.schemas import Keypoints, SyncMap
from imocap_core.artifacts.schemas.sync_schemas import SyncSummary
from imocap_core.body.layouts import layout_names


def tcc_sync(
    keypoints: Keypoints,
    *,
    reference: str,
    seed: int,
    settings: TccSettings = POSES,
    device: str = "cpu",
) -> SyncSummary:
    """Train TCC on an action's clips and align them to the reference video (an id).
    ValueError when a video gives no clip.
    """
    ids = [video.id for video in keypoints.videos]
    if reference not in ids:
        raise ValueError(f"reference: expected one of {', '.join(ids)}, got {reference!r}")
    clips = [
        pose_clip(video.xy_px, video.confidence, hip_columns(video.layout))
        for video in keypoints.videos
    ]
    alignment = align_by_tcc(
        clips,
        [video.fps for video in keypoints.videos],
        settings,
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
        method="TCC on poses",
        centrality=np.array([float(i == reference) for i in ids]),
        status=f"{settings.steps} steps, loss {first:.3f} to {last:.3f}",
    )


def hip_columns(layout: str) -> list[int]:
    """The columns of a layout's hips; ValueError when it has none."""
    names = layout_names(layout)
    columns = [names.index(name) for name in ("left_hip", "right_hip") if name in names]
    if not columns:
        raise ValueError(f"layout {layout}: TCC on poses needs the hips, which it does not have")
    return columns

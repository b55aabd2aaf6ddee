"""Errors of cameras and correspondences over all pairs of videos, which no choice of a reference
enters."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, permutations

import numpy as np

from imocap_core.artifacts.schemas import Camera, Keypoints, SyncSummary
from imocap_core.io.truth import Truth
from imocap_core.metrics.sync import sync_error_frames, sync_errors
from imocap_core.metrics.trajectory import camera_rotation_error_deg
from imocap_core.sync.axes import inverted

CAMERA, FRAMES = "camera_pair_error_deg", "sync_pair_error_frames"


def pair_errors(
    cameras: Sequence[Camera], sync: SyncSummary, keypoints: Keypoints, truth: Truth
) -> dict[str, float]:
    """Means over all pairs of videos that are neither excluded nor mirrored; NaN for no pair."""
    apart = {*sync.excluded, *sync.mirrored}
    used = [video.id for video in keypoints.videos if video.id not in apart]
    angles = camera_pair_errors_deg([c for c in cameras if c.id in used], truth)
    frames = sync_pair_errors_frames(used, sync, keypoints, truth)
    return {CAMERA: _mean(angles), FRAMES: _mean(frames)}


def camera_pair_errors_deg(cameras: Sequence[Camera], truth: Truth) -> list[float]:
    """Error of the rotation from one camera to another, of every pair whose true cameras are
    known."""
    true = {i: video.R for i, video in truth.videos.items() if video.R is not None}
    return [
        float(np.mean(camera_rotation_error_deg(a.R, b.R, true[a.id], true[b.id])))
        for a, b in combinations([c for c in cameras if c.id in true], 2)
    ]


def sync_pair_errors_frames(
    used: Sequence[str], sync: SyncSummary, keypoints: Keypoints, truth: Truth
) -> list[float]:
    """Mean error of each video's map into each other one, through the reference, in its frames."""
    phases = {i: v.phase for i, v in truth.videos.items() if v.phase is not None}
    videos = {video.id: video for video in keypoints.videos}
    maps = {sync_map.id: sync_map.reference_frame for sync_map in sync.maps}
    maps[sync.reference] = np.arange(float(len(maps[sync.reference])))
    errors = []
    with_truth = [i for i in used if i in phases and len(phases[i]) == len(maps[i])]
    for a, b in permutations(with_truth, 2):
        into = videos[b].frames
        matched = np.interp(inverted(maps[b], maps[a]), np.arange(len(into)), into)
        end = truth.phase_end or float(np.nanmax(phases[b]))
        of_pair = sync_errors(matched, phases[a], into, phases[b], end)
        errors.append(sync_error_frames(of_pair))
    return errors


def _mean(values: Sequence[float]) -> float:
    finite = [value for value in values if np.isfinite(value)]
    return float(np.mean(finite)) if finite else float("nan")

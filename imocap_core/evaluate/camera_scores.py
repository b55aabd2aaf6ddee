"""Scores of the cameras: rotation, place and focal length against the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from imocap_core.artifacts.schemas import Camera, SyncSummary
from imocap_core.io.truth import Truth, VideoTruth
from imocap_core.metrics import scoring
from imocap_core.metrics.camera import camera_place_errors_mm, focal_error_pct
from imocap_core.metrics.scoring import ScoreRow

ROTATION, PLACE, FOCAL = "camera_rotation_error_deg", "camera_place_error_mm", "focal_error_pct"
CAMERA_METRICS = (ROTATION, PLACE, FOCAL)
LEAST_PLACES = 3  # cameras: a similarity brings any two onto any two others
UNKNOWN = "the true cameras are not known"


def camera_rows(
    name: str, cameras: Sequence[Camera], sync: SyncSummary, truth: Truth | None
) -> list[ScoreRow]:
    """Every camera's errors; rows without a value have the reason."""
    true = {} if truth is None else truth.videos
    why = {camera.id: _left_out(camera.id, sync) for camera in cameras}
    scored = [camera for camera in cameras if not why[camera.id]]
    rows = _rotations(name, cameras, sync, true, why)
    rows += _places(name, scored, true)
    true_K = {i: v.K for i, v in true.items() if v.K is not None}
    for camera in (c for c in scored if c.id in true_K):
        error = focal_error_pct(camera.K[0, 0], true_K[camera.id][0, 0])
        rows.append(scoring.scored_row(name, camera.id, FOCAL, error, "not recovered"))
    have = {row.metric for row in rows}
    return rows + [
        ScoreRow(name, camera.id, metric, None, UNKNOWN)
        for metric in (PLACE, FOCAL)
        if metric not in have
        for camera in cameras
    ]


def _left_out(video: str, sync: SyncSummary) -> str:
    """Why a camera is not scored; empty where it is."""
    if video in sync.excluded:
        return "excluded"
    mirrored = {video, sync.reference} & {*sync.mirrored}
    return "mirrored: its world is a reflection" if mirrored else ""


def _rotations(
    name: str,
    cameras: Sequence[Camera],
    sync: SyncSummary,
    true: Mapping[str, VideoTruth],
    why: Mapping[str, str],
) -> list[ScoreRow]:
    """Of every camera but the reference's."""
    true_R = {i: v.R for i, v in true.items() if v.R is not None}
    estimated = {camera.id: camera.R for camera in cameras}
    reference, rows = sync.reference, []
    for video in (i for i in estimated if i != reference):
        if why[video]:
            rows.append(ScoreRow(name, video, ROTATION, None, why[video]))
        elif video in true_R and reference in true_R:
            pair = (estimated[video], estimated[reference], true_R[video], true_R[reference])
            rows.append(scoring.camera_row(name, video, *pair))
        else:
            rows.append(ScoreRow(name, video, ROTATION, None, UNKNOWN))
    return rows


def _places(name: str, scored: Sequence[Camera], true: Mapping[str, VideoTruth]) -> list[ScoreRow]:
    """Of the cameras whose true place is known."""
    true_centre = {i: -v.R.T @ v.t for i, v in true.items() if v.R is not None and v.t is not None}
    cameras = [camera for camera in scored if camera.id in true_centre]
    if not cameras:
        return []
    if len(cameras) < LEAST_PLACES:
        why = f"places are compared from {LEAST_PLACES} cameras on"
        return [ScoreRow(name, camera.id, PLACE, None, why) for camera in cameras]
    centres = np.array([-c.R.T @ c.t for c in cameras])
    errors = camera_place_errors_mm(centres, np.array([true_centre[c.id] for c in cameras]))
    return [
        scoring.scored_row(name, camera.id, PLACE, float(error), "not recovered")
        for camera, error in zip(cameras, errors, strict=True)
    ]

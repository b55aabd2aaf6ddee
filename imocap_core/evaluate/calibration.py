"""Errors against claimed covariances (normalised errors, coverage), as rows of numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.artifacts.schemas import Uncertainty, VideoMotion
from imocap_core.conventions import EVAL_12, EVAL_INDICES, SMPL_JOINTS
from imocap_core.evaluate.truth import true_joints, video_truth
from imocap_core.io.truth import Truth
from imocap_core.metrics.calibration import (
    coverage_error,
    covered_share,
    normalised_error,
    probability_content,
)
from imocap_core.metrics.joints import HIPS, missing_joints, root_relative
from imocap_core.metrics.scoring import ScoreRow

NORMALISED = ("normalised_error", "normalised_depth_error", "normalised_across_error")
COVERED = {"covered_50_share": 0.5, "covered_80_share": 0.8, "covered_90_share": 0.9}
METRICS = (*NORMALISED, *COVERED, "coverage_error")
CAMERA_ERROR, NORMALISED_CAMERA_ERROR = "camera_rotation_error_deg", "normalised_camera_error"


def normalised_rows(
    name: str, claimed: Uncertainty, motions: Sequence[VideoMotion], truth: Truth | None
) -> list[ScoreRow]:
    """Each video's normalised errors and coverage over 12 joints, or the reason why they cannot be
    scored."""
    rows = []
    for video, motion in zip(claimed.videos, motions, strict=True):
        errors = joint_errors_mm(motion, truth)
        if errors is None:
            rows += [ScoreRow(name, video.id, metric, None, "no truth") for metric in METRICS]
            continue
        along = np.einsum("tjx,tx->tj", errors, _line_of_sight(motion))
        across = np.sqrt(np.maximum((errors**2).sum(-1) - along**2, 0.0))
        pairs = (
            (np.linalg.norm(errors, axis=-1), video.sigma_mm),
            (along, video.depth_mm),
            (across, video.across_mm),
        )
        values = {
            metric: normalised_error(error, sigma[:, EVAL_INDICES])
            for metric, (error, sigma) in zip(NORMALISED, pairs, strict=True)
        }
        content = probability_content(errors, video.covariance_mm2[:, EVAL_INDICES])
        values |= {metric: covered_share(content, level) for metric, level in COVERED.items()}
        for metric, value in (values | {"coverage_error": coverage_error(content)}).items():
            scored = bool(np.isfinite(value))
            note = "" if scored else "no frame"
            rows.append(ScoreRow(name, video.id, metric, value if scored else None, note))
    return rows


def normalised_camera_rows(rows: Sequence[ScoreRow], claimed: Uncertainty) -> list[ScoreRow]:
    """Of each scored rotation of a camera its error over the claimed standard deviation."""
    sd_deg = {video.id: video.camera_rotation_deg for video in claimed.videos}
    normalised = []
    for row in (row for row in rows if row.metric == CAMERA_ERROR):
        value, note = None, row.note
        if row.value is not None:
            claims = sd_deg[row.video] > 0  # False where NaN
            value = row.value / sd_deg[row.video] if claims else None
            note = "" if claims else "no standard deviation is claimed"
        normalised.append(ScoreRow(row.result, row.video, NORMALISED_CAMERA_ERROR, value, note))
    return normalised


def joint_errors_mm(
    motion: VideoMotion, truth: Truth | None, joints: Sequence[str] = EVAL_12
) -> Float[np.ndarray, "T J 3"] | None:
    """Errors of joints relative to the hips' middle, camera axes; None where the truth has not all
    of them."""
    true = true_joints(video_truth(truth, motion.id), motion.frames)
    if true is None or missing_joints(true.names, (*joints, *HIPS)):
        return None
    predicted = root_relative(motion.joints, SMPL_JOINTS, joints)
    return np.asarray(1000 * (predicted - root_relative(true.joints_m, true.names, joints)))


def _line_of_sight(motion: VideoMotion) -> Float[np.ndarray, "T 3"]:
    """Unit vectors from the camera to the root."""
    root = motion.joints[:, 0]
    return np.asarray(root / np.linalg.norm(root, axis=-1, keepdims=True))

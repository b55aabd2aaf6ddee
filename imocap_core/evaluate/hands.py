"""Errors of the hands, as rows of numbers."""

from __future__ import annotations

import numpy as np

from imocap_core.artifacts.schemas import Hands
from imocap_core.evaluate.truth import video_truth
from imocap_core.io.truth import Truth
from imocap_core.metrics.hands import hand_mpjpe_mm, hand_mpjpe_scaled_mm, hand_pa_mpjpe_mm
from imocap_core.metrics.scoring import ScoreRow

ERRORS = ("hand_mpjpe_mm", "hand_mpjpe_scaled_mm", "hand_pa_mpjpe_mm", "hand_mpjpe_seen_mm")
VISIBLE_SHARE = "hand_seen_share"
METRICS = (*ERRORS, VISIBLE_SHARE)


def hand_rows(name: str, hands: Hands, truth: Truth | None) -> list[ScoreRow]:
    """Errors of every video's hands and the share with keypoints; no row without hands."""
    rows = []
    for video in hands.videos:
        rows.append(ScoreRow(name, video.id, VISIBLE_SHARE, float(video.visible.mean())))
        of_video = video_truth(truth, video.id)
        if of_video is None or of_video.hands is None or of_video.R is None:
            rows += [ScoreRow(name, video.id, m, None, "no truth of hands") for m in ERRORS]
            continue
        true = of_video.hands @ of_video.R.T  # errors are relative to the wrist: no translation
        visible = np.where(video.visible[..., None, None] > 0, video.points_m, np.nan)
        values = (
            hand_mpjpe_mm(video.points_m, true),
            hand_mpjpe_scaled_mm(video.points_m, true),
            hand_pa_mpjpe_mm(video.points_m, true),
            hand_mpjpe_mm(visible, true),
        )
        for metric, value in zip(ERRORS, values, strict=True):
            scored = np.isfinite(value)
            note = "" if scored else "no frame has both"
            rows.append(ScoreRow(name, video.id, metric, value if scored else None, note))
    return rows

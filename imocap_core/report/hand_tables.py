"""Hands against their truth, as rows and as the report's table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from imocap_core.artifacts.schemas import Hands, Table
from imocap_core.io.truth import Truth
from imocap_core.metrics.hands import hand_mpjpe_mm, hand_mpjpe_scaled_mm, hand_pa_mpjpe_mm
from imocap_core.metrics.scoring import ScoreRow
from imocap_core.report.tables import wide_table

ERRORS = ("hand_mpjpe_mm", "hand_mpjpe_scaled_mm", "hand_pa_mpjpe_mm", "hand_mpjpe_seen_mm")
SEEN = "hand_seen_share"
METRICS = (*ERRORS, SEEN)


def hand_rows(name: str, hands: Hands, truth: Truth | None) -> list[ScoreRow]:
    """Every video's hands; no row where the keypoints have none."""
    rows = []
    for found in hands.videos:
        rows.append(ScoreRow(name, found.id, SEEN, float(found.seen.mean())))
        own = None if truth is None else truth.videos.get(found.id)
        if own is None or own.hands is None or own.R is None:
            rows += [ScoreRow(name, found.id, m, None, "no truth of hands") for m in ERRORS]
            continue
        true = own.hands @ own.R.T  # only differences within a hand count
        seen = np.where(found.seen[..., None, None] > 0, found.points_m, np.nan)
        values = (
            hand_mpjpe_mm(found.points_m, true),
            hand_mpjpe_scaled_mm(found.points_m, true),
            hand_pa_mpjpe_mm(found.points_m, true),
            hand_mpjpe_mm(seen, true),
        )
        for metric, value in zip(ERRORS, values, strict=True):
            known = np.isfinite(value)
            rows.append(
                ScoreRow(
                    name, found.id, metric, value if known else None, "" if known else "never seen"
                )
            )
    return rows


def hand_tables(rows: Sequence[ScoreRow]) -> list[Table]:
    """One table, or none when there is nothing to say."""
    own = [row for row in rows if row.metric in METRICS]
    return [wide_table("hands", "Hands, by video", own, METRICS)] if own else []

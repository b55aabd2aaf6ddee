"""The report's table of hands."""

from __future__ import annotations

from collections.abc import Sequence

from imocap_core.artifacts.schemas import Table
from imocap_core.evaluate.hands import METRICS
from imocap_core.metrics.scoring import ScoreRow
from imocap_core.report.tables import wide_table


def hand_tables(rows: Sequence[ScoreRow]) -> list[Table]:
    """One table, or none without hands."""
    of_hands = [row for row in rows if row.metric in METRICS]
    return [wide_table("hands", "Hands, by video", of_hands, METRICS)] if of_hands else []

"""Real videos of one man on a balance beam, where this machine has them."""

import pytest

from tests.regression.comparison import Baseline, compare, lost, table
from tests.regression.measure import REAL, Scored

pytestmark = pytest.mark.regression


def test_no_metric_lost(balance_beam: Scored, baseline: Baseline) -> None:
    losses = lost(compare(baseline, REAL, balance_beam.summary()))
    assert not losses, f"worse than the baseline (docs/regression.md):\n{table(losses)}"


def test_offsets_are_found(balance_beam: Scored) -> None:
    """Recognised as one event without being declared; the offsets' median over the videos."""
    assert balance_beam.summary()["after loop"]["offset_error_frames"] <= 0.3


def test_poses_are_good_and_better_than_from_one_video(balance_beam: Scored) -> None:
    found = {result: row["pa_mpjpe_mm"] for result, row in balance_beam.summary().items()}
    assert found["after loop"] <= 70.0
    assert found["after loop"] < found["monocular"]

"""The sync benchmark's own parts: scores of known maps, tables."""

import json
from pathlib import Path

import numpy as np
import pytest

from stages.benchmarks.sync import EventRow, markdown, write_tables
from stages.benchmarks.sync_scenes import SyncScene
from stages.benchmarks.sync_score import event_errors_frames, pair_error_pct, score_maps


def scene() -> SyncScene:
    """Two videos of 101 phases; the second starts 5 later."""
    phases = [np.arange(101.0), np.arange(5.0, 95.0)]
    poses = [np.zeros((len(p), 14, 3)) for p in phases]
    return SyncScene("made", poses, phases, [30.0, 30.0], 100.0, events=[50, 45])


def test_true_maps_score_zero_and_shifted_ones_their_shift() -> None:
    made = scene()
    own, true = np.arange(101.0), np.arange(90.0) + 5.0
    assert score_maps(made, 0, [own, true]).error_pct == 0.0
    shifted = score_maps(made, 0, [own, true + 2.0], [np.ones(101), np.full(90, 0.5)])
    assert shifted.error_pct == pytest.approx(2.0)
    assert shifted.within_one == 0.0
    assert shifted.confidence == 0.5
    assert pair_error_pct(made, 1, 0, true - 1.0) == pytest.approx(1.0)


def test_an_unmatched_event_is_infinitely_far() -> None:
    made = scene()
    found = np.arange(90.0) + 6.0
    assert event_errors_frames(made, 0, [np.arange(101.0), found]) == pytest.approx([1.0])
    found[45] = np.nan
    assert np.isinf(event_errors_frames(made, 0, [np.arange(101.0), found])).all()


def test_tables_are_written_for_people_and_programs(tmp_path: Path) -> None:
    rows = [EventRow("serve", 0.25, float("inf"))]
    write_tables(tmp_path, "events", rows)
    assert "| serve | 0.25 | inf |" in markdown(rows)
    assert json.loads((tmp_path / "events.json").read_text())[0]["largest_frames"] is None
    assert (tmp_path / "events.csv").read_text().startswith("action,median_frames")

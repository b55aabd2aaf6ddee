"""The report's tables of trust, and the scores of videos that take no part."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from imocap_core.adapters.sync_maps import maps_of
from imocap_core.artifacts.schemas import CycleTriple, SyncTrust, VideoTrust
from imocap_core.evaluate.scoreboard import StageResult, against_truth, cycle_row
from imocap_core.io.truth import read_truth
from imocap_core.report.page import markdown
from imocap_core.report.uncertainty_tables import trust_tables
from tests.made_sync import stored_matrix
from tests.report.made import Made


@pytest.fixture(scope="module")
def made() -> Made:
    return Made()


def trust_of(made: Made) -> SyncTrust:
    nan = float("nan")
    return SyncTrust(
        videos=[
            VideoTrust(
                id=i, phase_s=np.arange(len(f)) / 30.0, outlier_score=1.0 + v / 8,
                mirror_margin=nan, left_out_frames=nan, left_out_s=nan, left_out_share=nan,
            )
            for v, (i, f) in enumerate(zip(made.ids, made.frames, strict=True))
        ],
        triples=[CycleTriple(videos=made.ids, frames=0.75, seconds=0.025, share=0.9)],
    )  # fmt: skip


def test_what_is_known_is_shown_and_the_rest_is_a_dash(made: Made) -> None:
    note = "v3 seems to show another action"
    sync = made.sync.model_copy(
        update={"trust": trust_of(made), "excluded": ["v3"], "notes": [note]}
    )
    videos, cycles = trust_tables(sync)
    assert videos.rows[2][:4] == ["v3", "excluded", 1.25, None]
    assert videos.note == "v3 seems to show another action."
    assert cycles.rows == [["v1 v2 v3", 0.75, 0.025, 0.9]]
    assert "| v3 | excluded | 1.250 | – |" in markdown(videos)
    assert trust_tables(made.sync) == []


def test_a_video_without_part_is_not_scored_against_the_others(made: Made, tmp_path: Path) -> None:
    made.write_truth(tmp_path / "truth.npz")
    frames = dict(zip(made.ids, made.frames, strict=True))
    truth = read_truth(tmp_path / "truth.npz", frames)
    whole = made.sync
    lost = whole.maps[2].model_copy(
        update={"reference_frame": whole.maps[2].reference_frame * np.nan}
    )
    out = whole.model_copy(update={"excluded": ["v3"], "maps": [*whole.maps[:2], lost]})
    cameras = made.single.cameras
    broken = [*cameras[:2], cameras[2].model_copy(update={"R": np.eye(3)})]
    plain, without = (
        against_truth(StageResult("x", made.final, c, s), made.keypoints, truth)
        for c, s in ((broken, whole), (broken, out))
    )
    assert plain["camera_rotation_error_deg"] > 20.0
    assert without["camera_rotation_error_deg"] < 1.0
    assert without["matched_share"] > 0.8


def test_the_cycle_residual_speaks_of_the_videos_that_take_part(made: Made) -> None:
    n = sum(made.sync.lengths[:2])
    relaxed = maps_of(made.sync).dense()
    relaxed[n:, :n] = relaxed[:n, n:] = 0.0
    stored = stored_matrix(relaxed, made.sync.ids, made.sync.lengths)
    whole = made.sync.model_copy(update=stored)
    out = whole.model_copy(update={"excluded": ["v3"]})
    assert (cycle_row("x", whole).value or 0) > 3.0
    assert cycle_row("x", out).value == 0.0

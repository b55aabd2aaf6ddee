"""The observability report in sentences, and the tables of uncertainty."""

from __future__ import annotations

import pytest

from imocap_core.artifacts.schemas import NearPair, Uncertainty, Viewpoint, WeakSpan
from imocap_core.evaluate.action_scores import CALIBRATION_METRICS, normalised_rows
from imocap_core.metrics.scoring import over_videos
from imocap_core.report.uncertainty_tables import (
    SHOWN,
    observability_markdown,
    observability_table,
    sentences,
    uncertainty_tables,
)
from tests.report.made import Made


def changed(made: Made, **values: object) -> Uncertainty:
    return made.claimed.model_copy(update=values)


def span(video: str, sigma_mm: float) -> WeakSpan:
    return WeakSpan(
        video=video,
        joint="left_wrist",
        first_frame=36,
        last_frame=57,
        begin_s=1.2,
        end_s=1.9,
        sigma_mm=sigma_mm,
        of_median=sigma_mm / 20,
    )


def test_a_joint_is_named_with_its_time(made: Made) -> None:
    lines = sentences(changed(made, weak=[span("v2", 85.0)]), made.refined.sync)
    assert (
        "v2: left wrist from 1.2 to 1.9 s (frames 36 to 57): 85 mm, 4.2 times the action's median."
        in lines
    )
    assert not any("No joint" in line for line in lines)


@pytest.mark.parametrize(("across", "constraint"), [(False, "priors"), (True, "the other videos")])
def test_near_identical_views_are_called_by_name(made: Made, across: bool, constraint: str) -> None:
    pair = NearPair(videos=["v2", "v3"], angle_deg=8.2, seen_across=across)
    assert sentences(changed(made, near=[pair]), made.refined.sync)[0] == (
        "v2 and v3 show the performer from nearly the same side (8 degrees apart): depth along "
        f"their line of sight depends on {constraint}."
    )


def test_a_missing_side_is_suggested_where_one_stands_out(made: Made) -> None:
    views = [Viewpoint(azimuth_deg=a, reduction=r) for a, r in ((0, 0.1), (90, 0.51), (180, 0.2))]
    line = sentences(changed(made, viewpoints=views), made.refined.sync)[0]
    assert line == (
        "One more video would help most from the performer's left: expected errors about 30% "
        "smaller."
    )
    left_out = made.refined.sync.model_copy(update={"excluded": ["v3"]})
    line = sentences(changed(made, viewpoints=views[:1]), left_out)[0]
    assert line.startswith("No side is suggested for one more camera: v3 may show what is missing")


def test_the_page_names_the_worst_and_the_file_all(made: Made) -> None:
    weak = [span("v1", 100.0 - k) for k in range(SHOWN + 3)]
    claimed = changed(made, weak=weak)
    assert sum("left wrist" in s for s in sentences(claimed, made.refined.sync)) == SHOWN
    assert "observability.md lists 3 more spans." in sentences(claimed, made.refined.sync)
    page = observability_markdown("yoga", claimed, made.refined.sync)
    assert page.count("left wrist") == SHOWN + 3
    assert page.startswith("# yoga: observability")
    table = observability_table(claimed, made.refined.sync)
    assert [row[0] for row in table.rows] == sentences(claimed, made.refined.sync)


def test_without_truth_claims_stand_alone(made: Made) -> None:
    motions = made.refined.motion.videos
    rows = normalised_rows("after loop", made.claimed, motions, None)
    assert {row.metric for row in rows} == set(CALIBRATION_METRICS)
    assert all(row.value is None and row.note == "no truth" for row in rows)
    tables = uncertainty_tables(made.claimed, motions, None, [*rows, *over_videos(rows)])
    by_video = tables[0]
    assert by_video.rows[-1][by_video.columns.index("sigma_mm")] == pytest.approx(20)
    assert by_video.rows[0][by_video.columns.index("normalised_error")] is None
    assert tables[1].rows[0][2:] == [None, None]

"""The comparison sees what it must see, and the committed baseline is complete."""

import math
from dataclasses import replace

import pytest

from tests.regression.comparison import (
    BASELINE,
    Baseline,
    Watch,
    compare,
    document,
    lost,
    parse,
    table,
)
from tests.regression.measure import MADE, REAL

LOWER = Watch("lower", tolerance_pct=10, tolerance_least=1, why="made up")
HIGHER = Watch("higher", tolerance_pct=10, tolerance_least=0.02, why="made up")
MADE_UP = Baseline(
    {"error_mm": LOWER, "share": HIGHER}, {"walk": {"after loop": {"error_mm": 50.0, "share": 0.9}}}
)
AFTER_LOOP_ONLY = ("camera_rotation_error_deg", "sync_error_pct", "sync_error_frames")


def test_the_tolerance_is_the_wider_of_share_and_least() -> None:
    assert LOWER.allowed(50.0) == pytest.approx(55.0)
    assert LOWER.allowed(2.0) == pytest.approx(3.0)
    assert HIGHER.allowed(0.9) == pytest.approx(0.81)
    assert HIGHER.allowed(0.1) == pytest.approx(0.08)


@pytest.mark.parametrize(
    ("error_mm", "share", "regressions"),
    [
        (50.0, 0.9, set()),
        (54.9, 0.82, set()),
        (5.0, 1.0, set()),  # better is no fault
        (55.1, 0.9, {"error_mm"}),
        (50.0, 0.80, {"share"}),
        (90.0, 0.1, {"error_mm", "share"}),
        (math.nan, 0.9, {"error_mm"}),
    ],
)
def test_a_loss_beyond_the_tolerance_is_a_regression(error_mm, share, regressions):
    verdicts = compare(MADE_UP, "walk", {"after loop": {"error_mm": error_mm, "share": share}})
    assert {v.metric for v in lost(verdicts)} == regressions


def test_what_is_no_longer_scored_is_a_regression() -> None:
    assert len(lost(compare(MADE_UP, "walk", {"after loop": {"error_mm": 50.0}}))) == 1
    assert len(lost(compare(MADE_UP, "walk", {}))) == 2


def test_the_table_says_which_metric_lost_how_much() -> None:
    (fault,) = lost(compare(MADE_UP, "walk", {"after loop": {"error_mm": 70.0, "share": 0.9}}))
    head, row = (" ".join(line.split()) for line in table([fault]).splitlines())
    assert head == "action result metric better baseline allowed got"
    assert row == "walk after loop error_mm lower 50.000 <= 55.000 70.000"


def test_every_committed_number_is_watched_and_worsening_it_is_seen(baseline: Baseline) -> None:
    """Worsened by one and a half tolerances each number fails, alone; by half of one, none does."""
    for action, results in baseline.values.items():
        for result, row in results.items():
            for metric, value in row.items():
                step = baseline.metrics[metric].allowed(value) - value
                for share, expected in ((1.5, [metric]), (0.5, []), (-1.5, [])):
                    moved = {**results, result: {**row, metric: value + share * step}}
                    found = [v.metric for v in lost(compare(baseline, action, moved))]
                    assert found == expected, (action, result, metric, share)


def test_the_committed_baseline_holds_both_actions_and_every_metric(baseline: Baseline) -> None:
    assert set(baseline.values) == {MADE, REAL}
    for action, results in baseline.values.items():
        assert list(results) == ["monocular", "single pass", "after loop"]
        unscored = {"mpjpe_24_mm"} if action == REAL else set()  # its truth has fewer joints
        expected = set(baseline.metrics) - unscored
        assert set(results["after loop"]) == set(results["single pass"]) == expected
        assert set(AFTER_LOOP_ONLY).isdisjoint(results["monocular"])
        assert {"mpjpe_mm", "pa_mpjpe_mm"} <= set(results["monocular"])
        assert all(math.isfinite(v) for row in results.values() for v in row.values())


def test_the_committed_baseline_is_as_make_baseline_writes_it(baseline: Baseline) -> None:
    assert BASELINE.read_text(encoding="utf-8") == document(baseline)
    assert parse(document(baseline)) == baseline


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (replace(LOWER, better="smaller"), "better: expected lower or higher, got smaller"),
        (replace(LOWER, tolerance_pct=0), "both tolerances must be above 0"),
        (replace(LOWER, why=" "), "expected a reason"),
    ],
)
def test_a_row_without_direction_tolerance_or_reason_is_refused(fault: Watch, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        parse(document(replace(MADE_UP, metrics={"error_mm": fault, "share": HIGHER})))


def test_a_value_that_nothing_says_how_to_compare_is_refused() -> None:
    with pytest.raises(ValueError, match=r"values\.walk\.after loop\.share"):
        parse(document(replace(MADE_UP, metrics={"error_mm": LOWER})))
    with pytest.raises(ValueError, match="expected better, tolerance_pct"):
        parse(document(MADE_UP).replace("    better: lower\n", ""))

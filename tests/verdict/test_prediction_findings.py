"""A video is named where the others predict it badly, and worse than it fits itself."""

from __future__ import annotations

import pytest

from imocap_core.verdict.prediction_findings import Prediction, prediction_findings


@pytest.mark.parametrize(
    ("error", "alone", "named"),
    [(4.0, 2.0, False), (25.0, 3.0, True), (25.0, 14.0, False), (float("nan"), 3.0, False)],
)
def test_a_bad_prediction_is_named(error: float, alone: float, named: bool) -> None:
    findings = prediction_findings([Prediction("v1", error, 0.3, alone)])
    assert [f.video for f in findings] == (["v1"] if named else [])


def test_the_worst_is_named_first() -> None:
    findings = prediction_findings([Prediction(v, e, 0.3, 2.0) for v, e in (("a", 12), ("b", 30))])
    assert [f.video for f in findings] == ["b", "a"]
    assert all(f.serious for f in findings)

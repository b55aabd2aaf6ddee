"""A video is named where the others predict it badly, and worse than it predicts itself."""

from __future__ import annotations

import pytest

from imocap_core.artifacts.schemas import PredictedVideo
from imocap_core.diagnostics.contradictions import prediction_findings

NAN = float("nan")


def predicted(video: str, error: float, alone: float = 0.03) -> PredictedVideo:
    return PredictedVideo(
        id=video, error_share=error, near_share=0.3, monocular_error_share=alone, frames=40
    )


@pytest.mark.parametrize(
    ("error", "alone", "named"),
    [(0.04, 0.02, False), (0.25, 0.03, True), (0.25, 0.14, False), (NAN, 0.03, False),
     (0.25, NAN, True)],
)  # fmt: skip
def test_a_bad_prediction_is_named(error: float, alone: float, named: bool) -> None:
    findings = prediction_findings([predicted("v1", error, alone)])
    assert [f.video for f in findings] == (["v1"] if named else [])


def test_the_worst_is_named_first() -> None:
    findings = prediction_findings([predicted("a", 0.12), predicted("b", 0.3)])
    assert [f.video for f in findings] == ["b", "a"]
    assert all(f.serious for f in findings)

"""Videos that the motion of the others does not predict (leave one video out)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from imocap_core.verdict.findings import Finding

FAR_PCT = 10.0  # of the height: an error as long as a hand
WORSE = 2.0  # times the error of the video's own monocular fit, which the picture itself bounds


@dataclass(frozen=True)
class Prediction:
    """How the others' motion, its warp and one resected camera fit a video's keypoints.

    Attributes:
        error_pct_height: median distance in % of the person's height in the picture; NaN unknown.
        share_10: share of the keypoints within 10 %; monocular: the error of the video's own fit.
    """

    video: str
    error_pct_height: float
    share_10: float
    monocular: float


def prediction_findings(predictions: Sequence[Prediction]) -> list[Finding]:
    """One finding per video that is predicted badly, the worst first."""
    bad = [p for p in predictions if p.error_pct_height > max(FAR_PCT, WORSE * p.monocular)]
    return [
        Finding(
            "body",
            p.video,
            f"the other videos predict its keypoints to {p.error_pct_height:.0f} % of the height "
            f"only, {p.share_10:.0%} of them within 10 % (its own fit: {p.monocular:.0f} %): the "
            "timing, the pose in depth or the action differs",
            "the others do not predict it",
            "compare them with `imocap view`",
        )
        for p in sorted(bad, key=lambda p: -p.error_pct_height)
    ]

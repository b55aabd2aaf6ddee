"""Videos that the motion of the others does not predict (leave one video out)."""

from __future__ import annotations

from collections.abc import Sequence

from imocap_core.artifacts.schemas import PredictedVideo
from imocap_core.verdict.findings import Finding

FAR = 0.1  # median error, of the height: as long as a hand
WORSE = 2.0  # times the error of limbs hidden from the video's own monocular fit


def prediction_findings(predicted: Sequence[PredictedVideo]) -> list[Finding]:
    """One finding per video that is predicted badly, the worst first."""
    bad = [p for p in predicted if p.error_share > _limit(p)]
    return [
        Finding(
            "body",
            p.id,
            f"the other videos' motion predicts its keypoints to {p.error_share:.0%} of the height "
            f"only, {p.near_share:.0%} of them within 10 %: the timing, the pose in depth or the "
            "action differs",
            "the others do not predict it",
            "compare them with `imocap view`",
        )
        for p in sorted(bad, key=lambda p: -p.error_share)
    ]


def _limit(predicted: PredictedVideo) -> float:
    """Python's max keeps the first of two where the second is NaN."""
    return max(FAR, WORSE * predicted.monocular_error_share)

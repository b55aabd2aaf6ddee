"""Stretches of videos in which the detector swapped left and right, as the other videos show."""

from __future__ import annotations

from imocap_core.artifacts.schemas import SmplBa
from imocap_core.verdict.findings import Finding

WHERE = {"above the hips": "above the hips", "legs": "of the legs", "body": "of the whole body"}


def swapped_findings(motion: SmplBa) -> list[Finding]:
    """A remark on each stretch: the result allows for it."""
    return [
        Finding(
            "remark",
            stretch.id,
            f"the detector swapped left and right {WHERE[stretch.part]}, as the other videos show; "
            "the motion was fitted with both put right",
            "left and right were put right",
            first_frame=stretch.first_frame,
            last_frame=stretch.last_frame,
        )
        for stretch in motion.swapped
    ]

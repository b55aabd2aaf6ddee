"""Stretches of videos in which the detector took left for right, put right by the other videos."""

from __future__ import annotations

from imocap_core.artifacts.schemas import SmplBa
from imocap_core.verdict.findings import Finding

WORDS = {
    "above the hips": "the left and the right side above the hips",
    "legs": "the left and the right leg",
    "body": "the whole body's left and right",
}


def swapped_findings(motion: SmplBa) -> list[Finding]:
    """A remark on each stretch: the result allows for it."""
    return [
        Finding(
            "remark",
            stretch.id,
            f"the detector took {WORDS[stretch.part]} for each other, as the other videos say; the "
            "motion was fitted with them put right",
            "left and right were put right",
            first_frame=stretch.first_frame,
            last_frame=stretch.last_frame,
        )
        for stretch in motion.swapped
    ]

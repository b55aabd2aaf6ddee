"""The joint choice in words."""

from __future__ import annotations

from collections.abc import Sequence

from imocap_core.sync.hypotheses.joint_choice import JointChoice

MEANINGS = {
    "best": "the likeliest one",
    "depth": "the one with its depth reversed",
    "facing": "the one that faces the other way",
    "sides": "the one reflected in depth, left and right swapped",
}
SWAPPED = "swapped"  # begins the names of motions for which the detector took left for right


def sentences(
    choice: JointChoice, names: Sequence[str], motions: Sequence[Sequence[str]]
) -> list[str]:
    """One sentence per video with another motion than the first, or with an equal rival.

    Args:
        names: of the videos; motions: per video, the names of its motions.
    """
    messages = []
    for v, label in enumerate(choice.labels):
        if label > 0:
            messages.append(
                f"{names[v]} alone may show several motions: not the likeliest is used but "
                f"{_meaning(motions[v][label])}, because it agrees better with the other videos"
            )
        rivals = dict.fromkeys(_meaning(motions[v][k]) for k in choice.rivals[v])
        rivals.pop(_meaning(motions[v][label]), None)
        if rivals:
            messages.append(
                f"{names[v]} may show several motions, and the videos do not decide between the "
                f"one that is used and {', or '.join(rivals)}"
            )
    return messages


def _meaning(name: str) -> str:
    if name.startswith(SWAPPED):
        return "one with left and right of its detections swapped for a while"
    return MEANINGS.get(name, f"another fit ({name})")

"""The joint choice in words."""

from __future__ import annotations

from collections.abc import Sequence

from imocap_core.sync.hypotheses.joint_choice import JointChoice

MEANINGS = {
    "best": "the likeliest one",
    "depth": "the one with its depth reversed",
    "facing": "the one that faces the other way",
    "sides": "the one reflected in depth, left and right exchanged",
}
EXCHANGED = "exchanged"  # begins the names of motions for which the detector took left for right


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
                f"{names[v]} by itself is explained by several motions; instead of the likeliest "
                f"{_meaning(motions[v][label])} is used, because it agrees better with the other "
                f"videos' keypoints"
            )
        rivals = dict.fromkeys(_meaning(motions[v][k]) for k in choice.rivals[v])
        rivals.pop(_meaning(motions[v][label]), None)
        if rivals:
            messages.append(
                f"{names[v]}: the videos do not decide between the motion that is used and "
                f"{', or '.join(rivals)}"
            )
    return messages


def _meaning(name: str) -> str:
    if name.startswith(EXCHANGED):
        return "one fitted with left and right exchanged for a while, as the other videos say"
    return MEANINGS.get(name, f"another fit ({name})")

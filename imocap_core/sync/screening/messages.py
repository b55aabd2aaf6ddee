"""The screening's decisions in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from imocap_core.sync.screening.outliers import LARGEST_SCORE
from imocap_core.sync.screening.screening import Screening


def sentences(screening: Screening, names: Sequence[str]) -> list[str]:
    """One sentence per video that is an outlier or mirrored; `names` of the videos."""
    messages = [_outlier(screening, v, names[v]) for v in screening.outliers]
    messages += [_mirrored(screening, v, names[v]) for v in screening.mirrored]
    messages += [
        f"{names[v]} is hardly better explained by the others' motion than by a pose that stands "
        f"still, but it is not clear that it shows another action: it takes part"
        for v in screening.undecided
    ]
    if screening.symmetric:
        messages.append(
            "the action is nearly its own mirror image, so no video is tested for being mirrored "
            "(mirrored: true in action.yaml flips one)"
        )
    left = len(names) - len(screening.excluded)
    if screening.excluded and left == 2:
        messages.append(
            "only two videos are left, and with two it cannot be decided which shows another "
            "action; check the excluded ones, or set sync.outliers: report"
        )
    return messages


def _outlier(screening: Screening, v: int, name: str) -> str:
    done = (
        "left out, its frames unmatched (sync.outliers: exclude)"
        if v in screening.excluded
        else "used nevertheless (sync.outliers: report)"
    )
    return (
        f"{name} seems to show another action: the other videos explain each other and not it "
        f"(score {screening.outlier_score[v]:.2f}, above {LARGEST_SCORE:.1f} is another "
        f"action): {done}"
    )


def _mirrored(screening: Screening, v: int, name: str) -> str:
    margin = screening.mirror_margin[v]
    why = (
        f"fits the others {100 * (np.exp(margin) - 1):.0f} % better reflected"
        if np.isfinite(margin) and margin > 0
        else "is declared mirrored"
    )
    done = (
        "treated as its mirror image"
        if v in screening.flipped
        else "left as it is (mirrored: true in action.yaml flips it)"
    )
    return f"{name} {why}: {done}"

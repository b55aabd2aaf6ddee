"""The screening's decisions in words."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from imocap_core.sync.screening.outliers import LARGEST_SCORE
from imocap_core.sync.screening.screening import Screening

ANOTHER_ACTION = "seems to show another action"
HARDLY_EXPLAINED = "is hardly better explained by the others' motion"
REFLECTED = "fits the others"
TWO_ARE_LEFT = "only two videos are left"


def sentences(screening: Screening, names: Sequence[str]) -> list[str]:
    """One sentence per video that is an outlier or mirrored; `names` of the videos."""
    messages = [_outlier(screening, v, names[v]) for v in screening.outliers]
    messages += [_mirrored(screening, v, names[v]) for v in screening.mirrored]
    messages += [
        f"{names[v]} {HARDLY_EXPLAINED} than by a pose that stands still, but it is not clear "
        f"that it shows another action: it takes part"
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
            f"{TWO_ARE_LEFT}, and with two it cannot be decided which shows another "
            "action; check the excluded ones, or set sync.outliers: report"
        )
    return messages


def corrected(
    before: Sequence[str],
    after: Sequence[str],
    *,
    changed: Collection[str],
    returned: Sequence[str],
    straight: Sequence[str],
) -> list[str]:
    """Sentences of a first screening, with those of videos that a second one decides otherwise
    replaced.

    Args:
        before, after: of the first, of the second. changed: the videos, by name; returned: those
            that take part again; straight: those that are no longer taken to be mirrored.
    """
    outdated = tuple(
        f"{video} {reason}"
        for video in sorted(changed)
        for reason in (ANOTHER_ACTION, HARDLY_EXPLAINED, REFLECTED)
    )
    outdated += (TWO_ARE_LEFT,)
    seemed = {
        "show another action, but the joint motion of the others explains it: it takes part": (
            returned
        ),
        "be mirrored, but the joint motion of the others explains it as it was filmed": straight,
    }
    return [
        *(note for note in before if not note.startswith(outdated)),
        *(f"{video} at first seemed to {what}" for what, of in seemed.items() for video in of),
        *(note for note in after if note.startswith(outdated)),
    ]


def _outlier(screening: Screening, v: int, name: str) -> str:
    done = (
        "left out, its frames unmatched (sync.outliers: exclude)"
        if v in screening.excluded
        else "used nevertheless (sync.outliers: report)"
    )
    return (
        f"{name} {ANOTHER_ACTION}: the other videos explain each other and not it "
        f"(score {screening.outlier_score[v]:.2f}, above {LARGEST_SCORE:.1f} is another "
        f"action): {done}"
    )


def _mirrored(screening: Screening, v: int, name: str) -> str:
    margin = screening.mirror_margin[v]
    why = (
        f"{REFLECTED} {100 * (np.exp(margin) - 1):.0f} % better reflected"
        if np.isfinite(margin) and margin > 0
        else "is declared mirrored"
    )
    done = (
        "treated as its mirror image"
        if v in screening.flipped
        else "left as it is (mirrored: true in action.yaml flips it)"
    )
    return f"{name} {why}: {done}"

"""Which videos take part, and which are mirrored, decided again by the joint motion.

The first screening knows monocular motions, and one that went wrong may make its own video, or
another, look like another action or mirrored. In a joint motion a wrong start has been put right,
or has been left out, and it tells one from the other more clearly (docs/decisions.md).
"""

from __future__ import annotations

from imocap_core.artifacts.schemas import SyncSummary
from imocap_core.sync.screening.messages import corrected, sentences
from imocap_core.sync.screening.screening import Screening


def decided_again(first: SyncSummary, second: Screening) -> SyncSummary | None:
    """The first synchronisation with a second screening's decisions; None where they are the same.

    Args:
        second: of the same videos, with the joint motion where they took part.
    """
    excluded, mirrored = (
        [first.ids[v] for v in videos] for videos in (second.excluded, second.flipped)
    )
    changed = {*excluded} ^ {*first.excluded} | {*mirrored} ^ {*first.mirrored}
    if not changed:
        return None
    notes = corrected(
        first.notes,
        sentences(second, first.ids),
        changed=changed,
        returned=[video for video in first.excluded if video not in excluded],
        straight=[v for v in first.mirrored if v not in mirrored and v not in excluded],
    )
    return first.model_copy(update={"excluded": excluded, "mirrored": mirrored, "notes": notes})

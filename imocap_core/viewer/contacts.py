"""When each foot rests on the ground, on the common axis: the lines under a video's lane."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float


def contact_spans(
    contacts: Mapping[str, Sequence[tuple[int, int]]], phase_s: Float[np.ndarray, " T"]
) -> dict[str, list[list[float]]]:
    """Contacts of each side from their first to their last frame, in seconds of the reference.

    phase_s: of every frame, never falling.
    """
    return {
        side: [[float(phase_s[first]), float(phase_s[last])] for first, last in spans]
        for side, spans in contacts.items()
    }

"""Events of a motion as comma-separated values."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from imocap_core.biomechanics.motion_event import MotionEvent

COLUMNS = (
    *("time_s", "earliest_s", "latest_s", "frame", "phase_s"),
    *("kind", "name", "value", "unit", "value_sd"),
)


def write_events_csv(
    file: Path,
    events: Sequence[MotionEvent],
    time_s: Float[np.ndarray, " T"],
    frames: Float[np.ndarray, " T"],
    phase_s: Float[np.ndarray, " T"],
) -> None:
    """Write events, a row each; what is NaN is left empty.

    time_s, frames, phase_s: of the frames whose positions the events' indices are.
    """
    position = np.arange(len(time_s))
    with file.open("w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(COLUMNS)
        for event in events:
            moments = (event.index, event.earliest, event.latest)
            times = [_text(np.interp(i, position, time_s)) for i in moments]
            frame = _text(np.interp(event.index, position, frames), 2)
            phase = _text(np.interp(event.index, position, phase_s))
            about = (event.kind, event.name, _text(event.value, 2), event.unit, _text(event.sd, 2))
            rows.writerow([*times, frame, phase, *about])


def _text(value: float, decimals: int = 4) -> str:
    return "" if np.isnan(value) else f"{value:.{decimals}f}"

"""Round trips over three videos, in the action's frames: what cycle consistency demands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from jaxtyping import Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from imocap_core.artifacts.schemas import Sync
from imocap_core.figures.cycle_trip import trips_of
from imocap_core.figures.overlays import CELL_PX, Image
from imocap_core.figures.style import (
    ACCENT,
    DPI,
    INK,
    QUIET,
    color_of,
    grid,
    headline,
    new_figure,
)

Positions = Int[np.ndarray, " T"]

SHARE = 0.55  # of a contact sheet's cell
LEFT_PX, TOP_PX, BELOW_PX, RIGHT_PX, LINE_PX = 150, 62, 26, 430, 22
NEAR_FRAMES = 2  # trips that end this close to their start count as closed


def cycle_figure(
    sync: Sync,
    trip: Sequence[str],
    starts: Sequence[int],
    cells: Mapping[str, Mapping[int, Image]],
    frames: Mapping[str, Int[np.ndarray, " _"]],
) -> Figure:
    """Frames of the first video of `trip`, their matches in the others and back, and the distance
    of every frame's end from its start, before and after cycle consistency.

    Args:
        trip: video ids; the trip returns to the first.
        starts: indices of the first video's used frames.
        cells: video -> index -> picture of a cell's size, for all indices of `cycle_frames`.
        frames: video -> source frame numbers.
    """
    before, after = trips_of(sync, trip)
    pictures = [
        [(video, int(position[s])) for s in starts]
        for video, position in zip([*trip, trip[0]], after, strict=True)
    ]
    pictures.append([(trip[0], int(before[-1][s])) for s in starts])
    names = [f"{trip[0]}: start", *(f"to {i}" for i in trip[1:]), f"back in {trip[0]}"]
    names.append("back, by the\naffinities alone")
    width, height = (round(SHARE * side) for side in CELL_PX)
    size = (
        LEFT_PX + len(starts) * (width + 6) + RIGHT_PX,
        TOP_PX + len(pictures) * (height + LINE_PX) + BELOW_PX,
    )
    figure = new_figure(size[0] / DPI, size[1] / DPI, arranged=False)
    for r, row in enumerate(pictures):
        top = TOP_PX + r * (height + LINE_PX)
        _text(figure, names[r], LEFT_PX - 12, top + height / 2, size, INK, "right")
        for c, (video, index) in enumerate(row):
            left = LEFT_PX + c * (width + 6)
            small = cv2.resize(cells[video][index], (width, height), interpolation=cv2.INTER_AREA)
            bottom = size[1] - top - height
            figure.figimage(small, left, bottom, origin="upper")
            caption, color = f"frame {frames[video][index]}", color_of(sync.ids, video)
            if r >= len(trip):
                off = index - int(starts[c])
                caption = f"{frames[video][index]} ({format(off, '+d') if off else '0'})"
                color = ACCENT if abs(off) > NEAR_FRAMES else color
            _text(figure, caption, left + width / 2, top + height + 10, size, color, "center")
    plot = (size[0] - RIGHT_PX + 90, 70, RIGHT_PX - 110, size[1] - TOP_PX - 100)
    box = (plot[0] / size[0], plot[1] / size[1], plot[2] / size[0], plot[3] / size[1])
    _returns(figure.add_axes(box), before, after, frames[trip[0]], trip)
    there = ", on to ".join(trip[1:])
    headline(
        figure,
        f"Round trip over {'two' if len(trip) == 2 else 'three'} videos",
        f"each column: a frame of {trip[0]}, its match in {there}, and from there in {trip[0]}",
    )
    return figure


def _returns(
    ax: Axes,
    before: list[Positions],
    after: list[Positions],
    frames: Positions,
    trip: Sequence[str],
) -> None:
    """The distance of every frame's end from its start."""
    for positions, color, name in (
        (before, "#d9a79b", "affinities alone"),
        (after, "#28588a", "cycle-consistent"),
    ):
        off = positions[-1] - positions[0]
        closed = float(np.mean(np.abs(off) <= NEAR_FRAMES))
        label = f"{name}: {closed:.0%} within {NEAR_FRAMES}"
        ax.plot(frames, off, color=color, lw=1.4, label=label)
    ax.axhline(0, color=QUIET, lw=0.7)
    ax.set_title("end minus start of each round trip")
    ax.set_xlabel(f"frame of {trip[0]}")
    ax.set_ylabel("frames")
    low, high = np.quantile(np.concatenate([before[-1] - before[0], [-6, 6]]), [0.02, 0.98])
    ax.set_ylim(1.3 * min(low, -6), 1.6 * max(high, 6))
    ax.legend(loc="upper right")
    grid(ax)


def _text(
    figure: Figure, text: str, x: float, y: float, size: tuple[int, int], color: str, side: str
) -> None:
    """Text at pixels from the upper left corner."""
    figure.text(x / size[0], 1 - y / size[1], text, color=color, ha=side, va="center", fontsize=7.5)

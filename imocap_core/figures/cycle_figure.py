"""Round three videos and back: what cycle consistency asks for, in the action's own frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from imocap_core.artifacts.schemas import Sync
from imocap_core.figures.cycle_trip import trips_of
from imocap_core.figures.overlays import CELL_PX
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

Ints = NDArray[np.int64]
Image = NDArray[np.uint8]

SHARE = 0.55  # of a contact sheet's cell
LEFT_PX, TOP_PX, BELOW_PX, RIGHT_PX, LINE_PX = 150, 62, 26, 430, 22
NEAR_FRAMES = 2  # ends this close to the start are no fault


def cycle_figure(
    sync: Sync,
    trip: Sequence[str],
    starts: Sequence[int],
    cells: Mapping[str, Mapping[int, Image]],
    frames: Mapping[str, Ints],
) -> Figure:
    """Frames of the first video of `trip`, those they lead to in the others and back, and how far
    from its start every frame ends, before and after cycle consistency.

    starts: indices of the first video's used frames. cells: video -> index -> picture of the size
    of a cell, for all that `cycle_frames` names. frames: video -> source frame numbers.
    """
    before, after = trips_of(sync, trip)
    pictures = [
        [(video, int(at[s])) for s in starts]
        for video, at in zip([*trip, trip[0]], after, strict=True)
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
        _word(figure, names[r], LEFT_PX - 12, top + height / 2, size, INK, "right")
        for c, (video, index) in enumerate(row):
            left = LEFT_PX + c * (width + 6)
            small = cv2.resize(cells[video][index], (width, height), interpolation=cv2.INTER_AREA)
            bottom = size[1] - top - height
            figure.figimage(small, left, bottom, origin="upper")
            said, color = f"frame {frames[video][index]}", color_of(sync.ids, video)
            if r >= len(trip):
                off = index - int(starts[c])
                said = f"{frames[video][index]} ({'home' if off == 0 else format(off, '+d')})"
                color = ACCENT if abs(off) > NEAR_FRAMES else color
            _word(figure, said, left + width / 2, top + height + 10, size, color, "center")
    plot = (size[0] - RIGHT_PX + 90, 70, RIGHT_PX - 110, size[1] - TOP_PX - 100)
    place = (plot[0] / size[0], plot[1] / size[1], plot[2] / size[0], plot[3] / size[1])
    _returns(figure.add_axes(place), before, after, frames[trip[0]], trip)
    there = ", on to ".join(trip[1:])
    headline(
        figure,
        f"Round {'two' if len(trip) == 2 else 'three'} videos and back",
        f"each column: a frame of {trip[0]}, its match in {there}, and from there in {trip[0]}",
    )
    return figure


def _returns(
    ax: Axes, before: list[Ints], after: list[Ints], frames: Ints, trip: Sequence[str]
) -> None:
    for at, color, name in (
        (before, "#d9a79b", "affinities alone"),
        (after, "#28588a", "cycle-consistent"),
    ):
        off = at[-1] - at[0]
        home = float(np.mean(np.abs(off) <= NEAR_FRAMES))
        label = f"{name}: {home:.0%} within {NEAR_FRAMES}"
        ax.plot(frames, off, color=color, lw=1.4, label=label)
    ax.axhline(0, color=QUIET, lw=0.7)
    ax.set_title("how far from the start each frame ends")
    ax.set_xlabel(f"frame of {trip[0]}")
    ax.set_ylabel("frames")
    low, high = np.quantile(np.concatenate([before[-1] - before[0], [-6, 6]]), [0.02, 0.98])
    ax.set_ylim(1.3 * min(low, -6), 1.6 * max(high, 6))
    ax.legend(loc="upper right")
    grid(ax)


def _word(
    figure: Figure, said: str, x: float, y: float, size: tuple[int, int], color: str, side: str
) -> None:
    """Text at pixels from the upper left corner."""
    figure.text(x / size[0], 1 - y / size[1], said, color=color, ha=side, va="center", fontsize=7.5)

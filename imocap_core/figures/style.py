"""One style for all figures and for text on pictures; image files without date and machine."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import cv2
import matplotlib as mpl
import numpy as np
from jaxtyping import UInt8
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from imocap_core.files import atomic_write

INK = "#22262b"
QUIET = "#5c636c"
GRID = "#e4e7ea"
TRUTH = "#22262b"
ACCENT = "#c8553d"

VIDEO_COLORS = (
    "#31689b",
    "#d0802f",
    "#4c9a6a",
    "#a94f5b",
    "#7766ab",
    "#8c7b4f",
    "#4d9fae",
    "#b9709d",
)
RESULT_COLORS = {"monocular": "#b9c0c8", "single pass": "#85a9cc", "after loop": "#28588a"}

DPI = 130

_STYLE = Path(__file__).with_name("figures.mplstyle")


@contextmanager
def quiet() -> Iterator[None]:
    """The style, for the duration of one figure; the caller's settings are restored.

    All others are matplotlib's defaults: a `matplotlibrc` that lies in the working folder changes
    no figure, and runs no LaTeX.
    """
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(mpl.rc_params_from_file(_STYLE, use_default_template=False))
        yield


def new_figure(width_in: float, height_in: float, *, arranged: bool = True) -> Figure:
    """An empty figure with a separate canvas: no window system, no global list of figures.

    arranged: axes and titles are laid out automatically.
    """
    layout: Literal["constrained"] | None = "constrained" if arranged else None
    size = (width_in, height_in)
    figure = Figure(figsize=size, dpi=DPI, layout=layout, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, path: Path) -> None:
    """Write a PNG, or a WebP whose ground is transparent, without metadata that differs.

    Axes and titles are laid out here, once: `savefig` would draw all of a figure for that alone.
    """
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine(None)
    with atomic_write(path) as draft:
        if path.suffix == ".png":
            figure.savefig(draft, dpi=DPI, metadata={"Software": None})
        else:
            # method: 0 fast to 6 small; 2 takes two fifths of the usual 4's time
            options = {"quality": 82, "method": 2}
            figure.savefig(draft, dpi=DPI, transparent=True, pil_kwargs=options)


def color_of(ids: Sequence[str], video: str) -> str:
    """The colour of a video in all figures of a report."""
    return VIDEO_COLORS[list(ids).index(video) % len(VIDEO_COLORS)]


def rgb_of(ids: Sequence[str], video: str) -> tuple[int, int, int]:
    """The same, 0 to 255."""
    r, g, b = (round(255 * c) for c in to_rgb(color_of(ids, video)))
    return r, g, b


def headline(figure: Figure, title: str, subtitle: str = "") -> None:
    """Title at the left; a paler second line explains how to read the figure."""
    text = f"{title}\n" if subtitle else title
    arranged = figure.get_layout_engine() is not None
    height = {} if arranged else {"y": 1 - 0.09 / figure.get_figheight()}
    figure.suptitle(text, x=0.012, ha="left", fontsize=11, fontweight="bold", color=INK, **height)
    if subtitle:
        offset = 0.31 / figure.get_figheight()  # inches below the top edge
        figure.text(0.012, 1 - offset, subtitle, ha="left", va="top", fontsize=8.5, color=QUIET)


def grid(axes: Axes, axis: str = "both") -> None:
    """Thin lines behind the data."""
    axes.grid(True, axis=axis)  # type: ignore[arg-type]


Image = UInt8[np.ndarray, "_ _ 3"]  # height, width, RGB
RGB = tuple[int, int, int]

_FONT = cv2.FONT_HERSHEY_SIMPLEX
WHITE, PALE = (255, 255, 255), (225, 225, 225)
DIMMED = 0.35
_STRIP_PX = 34  # height, on a picture of usual size
_MARK_PX = 6  # width of the coloured mark at its left end


def write(
    picture: Image,
    text: str,
    point: tuple[int, int],
    size: float,
    rgb: RGB = WHITE,
    before: float = 0.0,
) -> None:
    """Write on the picture; the share `before` of the text is left of `point`, on its baseline."""
    (width, _), _ = cv2.getTextSize(text, _FONT, size, 1)
    start = (round(point[0] - before * width), point[1])
    cv2.putText(picture, text, start, _FONT, size, rgb, 1, cv2.LINE_AA)


def write_strip(picture: Image, left: str, right: str, rgb: RGB, size: float) -> None:
    """Darken the upper edge and write the picture's title there; `rgb` marks its left end."""
    strip = round(_STRIP_PX * size)
    picture[:strip] = (picture[:strip] * DIMMED).astype(np.uint8)
    picture[:strip, :_MARK_PX] = rgb
    line = round(0.7 * strip)
    write(picture, left, (16, line), 0.62 * size)
    if right:
        write(picture, right, (picture.shape[1] - 10, line), 0.55 * size, PALE, 1.0)

"""Error of each joint under each result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from imocap_core.figures.style import RESULT_COLORS, grid, headline, new_figure


def joint_error_figure(
    names: Sequence[str], errors_mm: Mapping[str, Float[np.ndarray, " J"]]
) -> Figure:
    """Bars of the mean error of each joint, one colour per result.

    Args:
        names: the joints. errors_mm: result -> mean error over frames and videos, in mm.
    """
    figure = new_figure(8.6, 3.1)
    ax = figure.subplots()
    last = next(reversed(list(errors_mm)))
    order = np.argsort(errors_mm[last])
    width = 0.8 / len(errors_mm)
    for i, (result, errors) in enumerate(errors_mm.items()):
        centres = np.arange(len(names)) + (i - (len(errors_mm) - 1) / 2) * width
        label = f"{result}, mean {np.nanmean(errors):.0f} mm"
        ax.bar(centres, errors[order], 0.92 * width, color=RESULT_COLORS[result], label=label)
    ax.set_xticks(np.arange(len(names)), [names[j].replace("_", "\n") for j in order])
    ax.tick_params(axis="x", length=0)
    ax.set_ylabel("mean error (mm)")
    ax.margins(x=0.01)
    ax.legend(loc="upper left")
    grid(ax, "y")
    headline(figure, "Error of each joint", "root-relative, not scaled, mean over the videos")
    return figure

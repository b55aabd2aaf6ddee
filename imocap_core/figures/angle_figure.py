"""Joint angles over the action: the mean of the performances with its standard deviation."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from imocap_core.biomechanics.mean_curve import MeanCurve
from imocap_core.figures.style import QUIET, headline, new_figure

COLUMNS = 3
WIDTH_IN = 9.6
GAPS = {"hspace": 0.32, "wspace": 0.16}  # of a panel
LEFT, RIGHT, MIDDLE = "#31689b", "#d0802f", "#4a5058"
SIDES = (("left_", LEFT), ("right_", RIGHT))
SUBTITLE = (
    "degrees against seconds of the reference; line: mean of the performances, band: one standard "
    "deviation. Definitions: docs/angles.md"
)


def angle_figure(
    action: str, phase_s: Float[np.ndarray, " N"], curves: Mapping[str, MeanCurve]
) -> Figure:
    """A panel for every angle, left and right sides in one; a row for every joint."""
    titles = list(dict.fromkeys(map(_without_side, curves)))
    joints = list(dict.fromkeys(title.partition("_")[0] for title in titles))
    height = 0.9 + 1.45 * len(joints)
    figure = new_figure(WIDTH_IN, height, arranged=False)  # panels of one size: nothing to arrange
    edges = {"left": 0.48 / WIDTH_IN, "right": 1 - 0.12 / WIDTH_IN}
    edges |= {"bottom": 0.42 / height, "top": 1 - 0.84 / height}
    axes = figure.subplots(
        len(joints), COLUMNS, sharex=True, squeeze=False, gridspec_kw=edges | GAPS
    )
    for row, joint in enumerate(joints):
        of_joint = [title for title in titles if title.partition("_")[0] == joint]
        for column, ax in enumerate(axes[row]):
            if column < len(of_joint):
                _panel(ax, of_joint[column], phase_s, curves)
            else:
                ax.set_visible(False)
    for ax in axes[-1]:
        ax.set_xlabel("s")
    handles, labels = axes[joints.index("hip"), 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper right", ncols=2)
    headline(figure, f"{action}: joint angles", SUBTITLE)
    return figure


def _panel(
    ax: Axes, title: str, phase_s: Float[np.ndarray, " N"], curves: Mapping[str, MeanCurve]
) -> None:
    sides = [(p + title, p.rstrip("_"), c) for p, c in SIDES if p + title in curves]
    for name, label, colour in sides or [(title, "", MIDDLE)]:
        curve = curves[name]
        low, high = curve.mean_deg - curve.sd_deg, curve.mean_deg + curve.sd_deg
        ax.fill_between(phase_s, low, high, color=colour, alpha=0.2, linewidth=0)
        ax.plot(phase_s, curve.mean_deg, color=colour, label=label)
    ax.axhline(0, color=QUIET, lw=0.5, zorder=0)
    ax.grid(True, axis="y")
    ax.set_title(title.replace("_", " "))


def _without_side(name: str) -> str:
    return name.removeprefix("left_").removeprefix("right_")

"""Parts of a technique report: differences in words, Markdown and CSV tables, pictures."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from imocap_core.compare.compare import Curves, Technique, TechniqueAngles, TechniquePair
from imocap_core.conventions import SMPL_PARENTS
from imocap_core.figures.style import ACCENT, INK, QUIET, color_of, grid, headline, new_figure
from imocap_core.technique import MotionDifference, in_words, largest

_LEAST_LATE_S = 0.1
_OF_TWO, _OF_EACH = 8, 3  # sentences about two performers, and about each performance


def markdown_list(findings: Sequence[MotionDifference]) -> list[str]:
    """The sentences as a list of a Markdown report; nothing where there are none."""
    return [*(f"* {finding.sentence}" for finding in findings), ""] if findings else []


def pair_findings(pair: TechniquePair, angles: tuple[Curves, Curves]) -> list[MotionDifference]:
    """Where the second performer's mean angles differ most from the first's.

    Differences of a standard deviation of the repetitions or more come first, then the largest.
    """
    first, second = angles
    who, other = performer_names(pair)[::-1]
    return largest(
        who,
        other,
        pair.phase_s,
        {name: curve.mean_deg for name, curve in second.items()},
        {name: curve.mean_deg for name, curve in first.items()},
        {name: np.fmax(curve.sd_deg, second[name].sd_deg) for name, curve in first.items()},
    )[:_OF_TWO]


def performer_names(pair: TechniquePair) -> tuple[str, str]:
    """The names of both, told apart where they are the same."""
    first, second = pair.first.action, pair.second.action
    return (first, second) if first != second else (f"{first} (1)", f"{second} (2)")


def technique_findings(t: Technique, angles: TechniqueAngles) -> list[MotionDifference]:
    """Where each performance differs most from the mean: in its angles, then in its timing.

    Of two performances, where the second differs from the first: nobody performed their mean.
    """
    phase_s = t.instances.phase_s
    if len(t.instances.ids) == 2:
        first, second = t.instances.ids
        one, two = ({name: rows[m] for name, rows in angles.each.items()} for m in (0, 1))
        later_s = t.lead_s[1] - t.lead_s[0]
        return [
            *largest(second, first, phase_s, two, one, {})[:_OF_TWO],
            *_timing(second, first, phase_s, later_s),
        ]
    mean = {name: curve.mean_deg for name, curve in angles.mean.items()}
    differences = []
    for m, video in enumerate(t.instances.ids):
        each = {name: rows[m] for name, rows in angles.each.items()}
        differences += largest(video, "the mean", phase_s, each, mean, {})[:_OF_EACH]
        differences += _timing(video, "the mean", phase_s, t.lead_s[m])
    return differences


def _timing(
    video: str, other: str, phase_s: Float[np.ndarray, " N"], lead_s: Float[np.ndarray, " N"]
) -> list[MotionDifference]:
    if not np.isfinite(lead_s).any() or np.nanmax(np.abs(lead_s)) < _LEAST_LATE_S:
        return []
    moment = int(np.nanargmax(np.abs(lead_s)))
    word = "later" if lead_s[moment] > 0 else "earlier"
    sentence = (
        f"{video} is {abs(lead_s[moment]):.2f} s {word} than {other} at {phase_s[moment]:.2f} s"
    )
    return [MotionDifference(sentence, float(phase_s[moment]), None)]


_HEAT = LinearSegmentedColormap.from_list(
    "deviation", ["#ffffff", "#f6dfc8", "#e2a15f", "#c8553d", "#5f1f1a"]
)
_MOMENTS = 7  # columns of the motion figure
_MARGIN_M = 0.08  # about the bodies of a row of pictures
JointPlaces = Float[np.ndarray, "J 3"]
ModePose = tuple[float, JointPlaces, JointPlaces, JointPlaces]
_VIEWS = (("from the front", 0), ("from the left", 2))  # horizontal axis: x, or z reversed


def moments(count: int, columns: int = _MOMENTS) -> Int[np.ndarray, " C"]:
    """Indices of `columns` moments, evenly spaced."""
    return np.unique(
        np.linspace(0.03 * (count - 1), 0.97 * (count - 1), columns).round().astype(int)
    )


def motion_figure(
    ids: Sequence[str],
    phase_s: Float[np.ndarray, " N"],
    mean: Float[np.ndarray, "N J 3"] | None,
    each: Float[np.ndarray, "M N J 3"],
    inside: Bool[np.ndarray, "M N"],
    title: str,
    subtitle: str,
) -> Figure:
    """Skeletons of M motions at evenly spaced moments, over their mean.

    phase_s (N,); mean (N, J, 3) or None, each (M, N, J, 3): metres about the pelvis, y up, facing
    +z; inside (M, N): whether a motion shows the moment.
    """
    chosen = moments(len(phase_s))
    shown = each[:, chosen][inside[:, chosen]]
    windows = [_window(shown, view) for view in range(len(_VIEWS))]
    tall = [(y1 - y0) / max(x1 - x0 for x0, x1, _, _ in windows) for _, _, y0, y1 in windows]
    cell = 10.8 / len(chosen)
    figure = new_figure(11.4, 1.4 + cell * sum(tall))
    axes = figure.subplots(len(_VIEWS), len(chosen), squeeze=False, height_ratios=tall)
    for view, (name, _) in enumerate(_VIEWS):
        for column, t in enumerate(chosen):
            ax = axes[view, column]
            if mean is not None:
                draw_bones(ax, mean[t], view, INK, 1.6)
            for m, video in enumerate(ids):
                if inside[m, t]:
                    draw_bones(ax, each[m, t], view, color_of(ids, video), 1.1)
            _bare(ax, windows[view])
            if view == 0:
                ax.set_title(f"{phase_s[t]:.2f} s", fontsize=8.5, loc="center")
        axes[view, 0].set_ylabel(name)
    _legend(figure, ids, with_mean=mean is not None)
    headline(figure, title, subtitle)
    return figure


def draw_bones(
    ax: Axes, joints: Float[np.ndarray, "J 3"], view: int, color: str, width: float
) -> None:
    """One pose (J, 3) in one of `_VIEWS`."""
    across, up = _in_view(joints, view)
    for j, parent in enumerate(SMPL_PARENTS[: len(joints)]):
        if parent >= 0:
            ends = [parent, j]
            ax.plot(across[ends], up[ends], color=color, lw=width, solid_capstyle="round")


def _in_view(
    joints: Float[np.ndarray, "... 3"], view: int
) -> tuple[Float[np.ndarray, "..."], Float[np.ndarray, "..."]]:
    """Horizontal and vertical coordinate of joints (..., 3) in a view."""
    return (joints[..., 0] if _VIEWS[view][1] == 0 else -joints[..., 2]), joints[..., 1]


def _window(bodies: Float[np.ndarray, "... J 3"], view: int) -> tuple[float, float, float, float]:
    """Limits of a picture that shows all bodies (..., J, 3): left, right, below, above, metres."""
    across, up = _in_view(bodies, view)
    wide = float(np.abs(across).max()) + _MARGIN_M
    return -wide, wide, float(up.min()) - _MARGIN_M, float(up.max()) + _MARGIN_M


def deviation_figure(
    phase_s: Float[np.ndarray, " N"],
    deg: Float[np.ndarray, "N J"],
    mm: Float[np.ndarray, "N J"],
    names: Sequence[str],
    title: str,
    subtitle: str,
) -> Figure:
    """Heat maps of joints against phase: rotations (N, J) in degrees, positions (N, J) in mm."""
    figure = new_figure(11.4, 4.8)
    left, right = figure.subplots(1, 2, sharey=True)
    for ax, values, unit in ((left, deg, "rotation, degrees"), (right, mm, "position, mm")):
        finite = values[np.isfinite(values)]
        top = float(np.quantile(finite, 0.99)) if len(finite) else 1.0
        edges = _edges(phase_s)
        rows = np.arange(len(names) + 1) - 0.5
        picture = ax.pcolormesh(edges, rows, values.T, cmap=_HEAT, vmin=0, vmax=max(top, 1e-6))
        figure.colorbar(picture, ax=ax, pad=0.015, fraction=0.05).outline.set_visible(False)
        ax.set_title(unit)
        ax.set_xlabel("phase (s of the reference)")
        ax.set_yticks(range(len(names)), [in_words(n) for n in names], fontsize=7.5)
    left.invert_yaxis()
    headline(figure, title, subtitle)
    return figure


def modes_figure(
    ids: Sequence[str],
    share: Float[np.ndarray, " K"],
    scores: Float[np.ndarray, "M K"],
    of_joints: Float[np.ndarray, "K J"],
    names: Sequence[str],
    poses: Sequence[ModePose],
) -> Figure:
    """Up to three modes, one row each: scores of the performances, joints that turn, and poses.

    poses: per mode the phase of its largest effect, seconds, and the body there (J, 3): the mean,
    and the mean one standard deviation to either side.
    """
    count = len(poses)
    figure = new_figure(11.4, 1.0 + 2.1 * count)
    axes = figure.subplots(count, 4, squeeze=False, width_ratios=[1.1, 1.5, 1, 1])
    for k, (at_s, *bodies) in enumerate(poses):
        who, which, *views = axes[k]
        who.barh(range(len(ids)), scores[:, k], color=[color_of(ids, i) for i in ids], height=0.6)
        who.set_yticks(range(len(ids)), ids)
        who.axvline(0, color=QUIET, lw=0.7)
        who.invert_yaxis()
        who.set_title(f"mode {k + 1}: {100 * share[k]:.0f} % of the deviations")
        who.set_xlabel("score (degrees)")
        top = np.argsort(-of_joints[k])[:6]
        which.barh(range(len(top)), of_joints[k, top], color=ACCENT, height=0.6)
        which.set_yticks(range(len(top)), [in_words(names[j]) for j in top], fontsize=7.5)
        which.invert_yaxis()
        which.set_xlabel("degrees at one standard deviation")
        for view, ax in enumerate(views):
            for body, color, width in zip(
                bodies, (QUIET, ACCENT, "#31689b"), (1.2, 1.8, 1.8), strict=True
            ):
                draw_bones(ax, body, view, color, width)
            _bare(ax, _window(np.stack(bodies), view))
            ax.set_title(f"{at_s:.2f} s, {_VIEWS[view][0]}", fontsize=8.5)
    headline(
        figure,
        "Ways to differ",
        "low-rank modes of the deviations from the mean motion; right: the moment of the largest "
        "effect, mean (grey), one standard deviation more (red) and less (blue)",
    )
    return figure


def timing_figure(
    ids: Sequence[str], phase_s: Float[np.ndarray, " N"], lead_s: Float[np.ndarray, "M N"]
) -> Figure:
    """How much later than the mean each performance (M, N) reaches every moment, seconds."""
    figure = new_figure(11.4, 2.7)
    ax = figure.subplots()
    ax.axhline(0, color=QUIET, lw=0.7)
    for m, video in enumerate(ids):
        ax.plot(phase_s, lead_s[m], color=color_of(ids, video), label=video)
    ax.set_xlabel("phase (s of the reference)")
    ax.set_ylabel("later than the mean (s)")
    grid(ax)
    ax.legend(ncols=len(ids), loc="upper left")
    headline(
        figure,
        "Timing",
        "each video's clock, started at the first moment that all show; falling = faster",
    )
    return figure


def _legend(figure: Figure, ids: Sequence[str], *, with_mean: bool) -> None:
    from matplotlib.lines import Line2D

    lines = [Line2D([], [], color=color_of(ids, i), lw=1.2) for i in ids]
    names = list(ids)
    if with_mean:
        lines, names = [*lines, Line2D([], [], color=INK, lw=2)], [*names, "mean"]
    figure.legend(lines, names, loc="outside lower center", ncols=len(names))


def _bare(ax: Axes, window: tuple[float, float, float, float]) -> None:
    ax.set_aspect("equal")
    ax.set_xlim(*window[:2])
    ax.set_ylim(*window[2:])
    ax.set_xticks([])
    ax.set_yticks([])
    for side in ("left", "bottom"):
        ax.spines[side].set_visible(False)


def _edges(phase_s: Float[np.ndarray, " N"]) -> Float[np.ndarray, " N1"]:
    step = float(np.median(np.diff(phase_s))) if len(phase_s) > 1 else 1.0
    return np.concatenate([phase_s - step / 2, phase_s[-1:] + step / 2])


def number(value: float, decimals: int = 1) -> str:
    """A number for a table; a dash where it is unknown."""
    return f"{value:.{decimals}f}" if np.isfinite(value) else "–"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """A Markdown table; the first column is words, the others numbers."""
    line = "|" + "|".join(["---", *["---:"] * (len(head) - 1)]) + "|"
    return ["| " + " | ".join(head) + " |", line, *("| " + " | ".join(r) + " |" for r in rows)]


def joint_rows(
    names: Sequence[str],
    deg: Float[np.ndarray, " J"],
    mm: Float[np.ndarray, " J"],
    consistency: Float[np.ndarray, " J"],
) -> list[tuple[str, str, str, str]]:
    """One row per joint: spread of its rotation and position, and its consistency; largest spread
    of position first."""
    order = np.argsort(np.where(np.isfinite(mm), -mm, np.inf), kind="stable")
    return [
        (in_words(names[j]), number(deg[j]), number(mm[j]), number(consistency[j], 3))
        for j in order
    ]


def moment_sentences(
    phase_s: Float[np.ndarray, " N"],
    values: Float[np.ndarray, "N J"],
    names: Sequence[str],
    unit: str,
) -> list[str]:
    """Where a spread or a difference (N, J) is largest: three joints, and when."""
    peak = np.nanmax(np.where(np.isfinite(values), values, -np.inf), axis=0)
    order = [j for j in np.argsort(-peak)[:3] if np.isfinite(peak[j])]
    return [
        f"* {in_words(names[j])}: {number(float(peak[j]))} {unit} at "
        f"{phase_s[int(np.nanargmax(values[:, j]))]:.2f} s"
        for j in order
    ]


def write_course(
    file: Path,
    phase_s: Float[np.ndarray, " N"],
    names: Sequence[str],
    columns: dict[str, Float[np.ndarray, "N J"]],
) -> None:
    """One row per moment and joint: `columns` (N, J) by name, empty where unknown."""
    with file.open("w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(["phase_s", "joint", *columns])
        for t, phase in enumerate(phase_s):
            for j, name in enumerate(names):
                rows.writerow([f"{phase:.4f}", name, *(_cell(c[t, j]) for c in columns.values())])


def write_performances(
    file: Path, ids: Sequence[str], columns: dict[str, Float[np.ndarray, " M"]]
) -> None:
    """One row per performance: `columns` (M,) by name."""
    with file.open("w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(["video", *columns])
        for m, video in enumerate(ids):
            rows.writerow([video, *(_cell(c[m]) for c in columns.values())])


def _cell(value: float) -> str:
    return f"{value:.4f}" if np.isfinite(value) else ""

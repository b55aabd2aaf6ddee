"""Parts of a technique report: Markdown tables and sentences, and CSV files."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from imocap_core.compare.figures import in_words


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

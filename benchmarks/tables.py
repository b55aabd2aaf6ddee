"""Tables for people (Markdown) and programs (CSV, JSON), and what all benchmarks put into them."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

SCALED, PA = "mpjpe_scaled_mm", "pa_mpjpe_mm"
ALL_JOINTS = "mpjpe_24_mm"
SYNC, SYNC_MS, MATCHED = "sync_error_pct", "sync_error_ms", "matched_share"
CAMERA = "camera_rotation_error_deg"
ROOT = "root_path_aligned_error_mm"
ABSENT = "–"
DETAILS = "<!-- details -->"  # a report's line; the documentation shows what precedes it


def mean_and_error(values: Sequence[float]) -> tuple[float, float]:
    """Mean and its standard error (NaN for less than two values)."""
    count = len(values)
    if count == 0:
        return math.nan, math.nan
    mean = sum(values) / count
    if count < 2:
        return mean, math.nan
    spread = math.sqrt(sum((value - mean) ** 2 for value in values) / (count - 1))
    return mean, spread / math.sqrt(count)


def finite_mean(values: Sequence[float]) -> float:
    """The mean of the finite ones; NaN for none."""
    finite = [value for value in values if np.isfinite(value)]
    return float(np.mean(finite)) if finite else math.nan


def finite_median(values: Sequence[float]) -> float:
    """The median of the finite ones; NaN for none."""
    finite = [value for value in values if np.isfinite(value)]
    return float(np.median(finite)) if finite else math.nan


def gap_closed(monocular: float | None, reached: float | None, oracle: float | None) -> float:
    """Share of the way from the monocular fit to the oracle, in %; NaN when there is no way."""
    if monocular is None or reached is None or oracle is None or monocular <= oracle:
        return math.nan
    return 100.0 * (monocular - reached) / (monocular - oracle)


def mean_cell(values: Sequence[float], digits: int) -> str:
    """Mean ± standard error; a dash for no values."""
    mean, error = mean_and_error(values)
    if not math.isfinite(mean):
        return ABSENT
    return f"{mean:.{digits}f}" + (f" ± {error:.{digits}f}" if math.isfinite(error) else "")


def cell(value: float | None, digits: int) -> str:
    """A number of a table; a dash for none."""
    return ABSENT if value is None or not math.isfinite(value) else f"{value:.{digits}f}"


def markdown_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def missing_sentence(missing: Sequence[str]) -> str:
    """The actions that the table lacks; empty for none."""
    return f" **Missing (not measured on this code): {', '.join(missing)}.**" if missing else ""


def markdown_of_rows(rows: Sequence[Any]) -> str:
    """Dataclass instances as a table: a column a field, two decimals."""
    return markdown_table(list(asdict(rows[0])), _cells(rows))


def table_of_rows(rows: Sequence[Any]) -> Table:
    """The same for the terminal."""
    table = Table(*asdict(rows[0]), box=None, pad_edge=False)
    for cells in _cells(rows):
        table.add_row(*cells)
    return table


def _cells(rows: Sequence[Any]) -> list[list[str]]:
    return [
        [f"{v:.2f}" if isinstance(v, float) else str(v) for v in asdict(row).values()]
        for row in rows
    ]


def write_rows(folder: Path, name: str, rows: Sequence[Any]) -> None:
    """Dataclass instances as `name`.md, .csv and .json in `folder`."""
    fields = [asdict(row) for row in rows]
    out = io.StringIO()
    writer = csv.DictWriter(out, list(fields[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(fields)
    plain = [{k: v if _fits_json(v) else None for k, v in f.items()} for f in fields]
    write_texts(
        folder,
        {
            f"{name}.md": markdown_of_rows(rows) + "\n",
            f"{name}.csv": out.getvalue(),
            f"{name}.json": json.dumps(plain, indent=1) + "\n",
        },
    )


def write_texts(folder: Path, texts: Mapping[str, str]) -> None:
    """Write texts, by their files' names, into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")


def _fits_json(value: object) -> bool:
    return not isinstance(value, float) or bool(np.isfinite(value))

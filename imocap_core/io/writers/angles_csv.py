"""Joint angles as comma-separated values."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float


def write_angles_csv(file: Path, columns: Mapping[str, Float[np.ndarray, " T"]]) -> None:
    """Write columns of one length, a row each moment; what is NaN is left empty.

    Seconds and frames have four decimals, angles (names that end with `_deg`) two.
    """
    with file.open("w", newline="", encoding="utf-8") as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(columns)
        texts = [[_text(value, name) for value in values] for name, values in columns.items()]
        rows.writerows(zip(*texts, strict=True))


def _text(value: float, name: str) -> str:
    if np.isnan(value):
        return ""
    return f"{value:.2f}" if name.endswith("_deg") else f"{value:.4f}".rstrip("0").rstrip(".")

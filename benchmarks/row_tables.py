"""Rows of dataclasses as tables for people and programs."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np


def markdown(rows: Sequence[Any]) -> str:
    """A column a field, two decimals."""
    told = [asdict(row) for row in rows]
    lines = [list(told[0]), ["---"] * len(told[0])]
    lines += [[f"{v:.2f}" if isinstance(v, float) else str(v) for v in t.values()] for t in told]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def write_tables(folder: Path, name: str, rows: Sequence[Any]) -> None:
    """`name`.md, .csv and .json in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    told = [asdict(row) for row in rows]
    (folder / f"{name}.md").write_text(markdown(rows) + "\n")
    out = io.StringIO()
    writer = csv.DictWriter(out, list(told[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(told)
    (folder / f"{name}.csv").write_text(out.getvalue())
    plain = [{k: v if _can_be_json(v) else None for k, v in t.items()} for t in told]
    (folder / f"{name}.json").write_text(json.dumps(plain, indent=1) + "\n")


def _can_be_json(value: object) -> bool:
    return not isinstance(value, float) or bool(np.isfinite(value))

"""Tables as CSV and JSON, and the text of a cell."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence

from imocap_core.artifacts.schemas import Table
from imocap_core.artifacts.schemas.evaluate import Cell

DECIMALS = {
    "mm": 1,
    "px": 1,
    "pct": 2,
    "deg": 2,
    "frames": 2,
    "ms": 1,
    "s2": 2,
    "s3": 1,
    "share": 2,
    "s": 1,
}
DECIMALS |= {"seconds": 1, "frame": 1, "fps": 2}


def cell_text(column: str, value: Cell) -> str:
    """A cell's text, rounded by the unit that ends the column's name."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else ""
    if isinstance(value, float):
        return f"{value:.{DECIMALS.get(column.rsplit('_', 1)[-1], 3)}f}"
    return str(value)


def csv_text(table: Table) -> str:
    """Comma-separated, full precision; an empty cell could not be scored."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(table.columns)
    writer.writerows([["" if v is None else v for v in row] for row in table.rows])
    return out.getvalue()


def json_text(tables: Sequence[Table]) -> str:
    """All tables, each as a list of records; null could not be scored."""
    content = {t.name: [dict(zip(t.columns, row, strict=True)) for row in t.rows] for t in tables}
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"

"""Tables as Markdown, HTML, CSV and JSON."""

from __future__ import annotations

import csv
import html
import io
import json
from collections.abc import Mapping, Sequence

from imocap_core.artifacts.schemas import Table
from imocap_core.artifacts.schemas.evaluate import Cell
from imocap_core.metrics.scoring import ALL_VIDEOS

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


def markdown(table: Table) -> str:
    """A GitHub table with its title; numbers are right-aligned."""
    numeric = _numeric(table)
    lines = [
        f"### {table.title}",
        "",
        "| " + " | ".join(f"`{c}`" if "_" in c else c for c in table.columns) + " |",
        "|" + "|".join(" ---: " if n else " --- " for n in numeric) + "|",
    ]
    for row in table.rows:
        texts = [
            cell_text(c, v).replace("|", "\\|") for c, v in zip(table.columns, row, strict=True)
        ]
        lines.append("| " + " | ".join(texts) + " |")
    return "\n".join([*lines, "", *([table.note, ""] if table.note else [])])


def html_table(table: Table, glossary: Mapping[str, str] | None = None) -> str:
    """An HTML table; a column that `glossary` explains links to its entry (#name) in the page."""
    numeric = _numeric(table)
    head = "".join(
        f"<th{_right(n)}>{_head(c, glossary or {})}</th>"
        for c, n in zip(table.columns, numeric, strict=True)
    )
    body = []
    for row in table.rows:
        cells = zip(table.columns, row, numeric, strict=True)
        total = ' class="total"' if ALL_VIDEOS in row else ""
        inside = "".join(f"<td{_right(n)}>{html.escape(cell_text(c, v))}</td>" for c, v, n in cells)
        body.append(f"<tr{total}>{inside}</tr>")
    note = f"<p>{html.escape(table.note)}</p>" if table.note else ""
    return (
        f"<h3>{html.escape(table.title)}</h3>\n"
        f"<table><thead><tr>{head}</tr></thead>\n<tbody>{''.join(body)}</tbody></table>{note}\n"
    )


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


def _numeric(table: Table) -> list[bool]:
    """Which columns contain numbers."""
    columns = zip(*table.rows, strict=True) if table.rows else [()] * len(table.columns)
    return [
        any(isinstance(v, int | float) and not isinstance(v, bool) for v in column)
        for column in columns
    ]


def _head(column: str, glossary: Mapping[str, str]) -> str:
    name = html.escape(column).replace("_", "_<wbr>")
    if column not in glossary:
        return name
    return f'<a href="#{column}" title="{html.escape(glossary[column])}">{name}</a>'


def _right(numeric: bool) -> str:
    return ' class="n"' if numeric else ""

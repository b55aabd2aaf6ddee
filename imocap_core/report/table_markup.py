"""Tables as Markdown and HTML, their columns in words."""

from __future__ import annotations

import html
from collections.abc import Mapping

from imocap_core.artifacts.schemas import Table
from imocap_core.metrics.scoring import ALL_VIDEOS
from imocap_core.report.column_titles import column_title
from imocap_core.report.table_text import cell_text


def markdown(table: Table) -> str:
    """A GitHub table with its title; numbers are right-aligned."""
    numeric = _numeric(table)
    lines = [
        f"### {table.title}",
        "",
        "| " + " | ".join(map(column_title, table.columns)) + " |",
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
    note = f"<p>{html.escape(table.note)}</p>\n" if table.note else ""
    title = html.escape(table.title)
    return (
        f'<h3>{title}</h3>\n<div class="wide" tabindex="0" role="region" aria-label="{title}">'
        f"<table><thead><tr>{head}</tr></thead>\n<tbody>{''.join(body)}</tbody></table></div>\n"
        f"{note}"
    )


def _numeric(table: Table) -> list[bool]:
    """Which columns contain numbers."""
    columns = zip(*table.rows, strict=True) if table.rows else [()] * len(table.columns)
    return [
        any(isinstance(v, int | float) and not isinstance(v, bool) for v in column)
        for column in columns
    ]


def _head(column: str, glossary: Mapping[str, str]) -> str:
    name = html.escape(column_title(column))
    if column not in glossary:
        return name
    return f'<a href="#{column}" title="{html.escape(glossary[column])}">{name}</a>'


def _right(numeric: bool) -> str:
    return ' class="n"' if numeric else ""

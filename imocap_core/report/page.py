"""The report's page: HTML with embedded pictures."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from imocap_core.artifacts.schemas import Table
from imocap_core.diagnostics.findings import Verdict
from imocap_core.metrics.scoring import ALL_VIDEOS
from imocap_core.report.first_page import ANGLES, FirstPage
from imocap_core.report.page_files import badge, html_head, prose, sentences
from imocap_core.report.sections import Section
from imocap_core.report.table_files import GLOSSARY, Contents, Picture, cell_text, column_title


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


_MIME = {".png": "image/png", ".jpg": "image/jpeg", ".webp": "image/webp"}
_STAMP = "imocap-made-from"
_COLUMNS = "Glossary of the columns"
DETAILS = "Details of the verdict"
_TECHNICAL = "Technical details"
_ALIKE = "No angle differs between the videos by more than twice its expected error."
_BODY = "The recovered body at rest and at six moments: from the front, its right, and its back."


def html_page(
    folder: Path,
    contents: Contents,
    verdict: Verdict,
    parts: Sequence[Section],
    pages: str,
    stamp: str,
    sources: str = "",
    first: FirstPage | None = None,
) -> str:
    """One page that needs no other file: a first page for a person, then the technical details.

    pages: links to the action's other pages, as HTML. sources: which video is which file.
    """
    titles = [*(p.title for p in parts), _COLUMNS]
    nav = " ".join(f'<a href="#{_anchor(title)}">{html.escape(title)}</a>' for title in titles)
    tables = [table for part in parts for table in (*part.tables, *part.folded_tables)]
    glossary = {c: GLOSSARY[c] for t in tables for c in t.columns if c in GLOSSARY}
    title, leading = html.escape(contents.title), _leading(contents)
    findings = "".join(f"<li>{prose(f.sentence)}</li>" for f in verdict.findings)
    return (
        html_head(title, "report.css", f'<meta name="{_STAMP}" content="{stamp}">')
        + f"<h1>{title}{badge(verdict)}</h1>\n{sentences(verdict)}{pages}\n"
        + _first(folder, leading, first)
        + f'<details id="technical"><summary>{_TECHNICAL}</summary>\n'
        + (f"<p>{html.escape(sources)}</p>\n" if sources else "")
        + f"<nav>{nav}</nav>\n"
        + (f"<h2>{DETAILS}</h2>\n<ul>{findings}</ul>\n" if findings else "")
        + "".join(_section(folder, part, glossary, leading) for part in parts)
        + _glossary(glossary)
        + "</details></body></html>\n"
    )


def _leading(contents: Contents) -> list[Picture | None]:
    """The pictures of the first page: the same moments, and the body."""
    beginnings = ("moments.", "body_")
    return [next((p for p in contents.pictures if p.file.startswith(b)), None) for b in beginnings]


def _first(folder: Path, leading: Sequence[Picture | None], first: FirstPage | None) -> str:
    """The key angles and the differences, the same moments, the body."""
    moments, body = leading
    parts = [] if first is None or not first.since else [f"<p>{html.escape(first.since)}</p>"]
    if first is not None:
        caption = "The angles that change most; the upright line is the moment of the table."
        chart = _figure(folder, Picture(ANGLES, caption))
        table = f"<section><h2>Key angles</h2>\n{_angles(first)}</section>"
        parts.append(f'<div class="pair">{table}{chart}</div>')
    if moments is not None:
        parts.append(f"<h2>The same moments</h2>\n{_figure(folder, moments)}")
    if body is not None:
        parts.append(f"<h2>The body</h2>\n{_figure(folder, replace(body, caption=_BODY))}")
    return f'<div class="first">{"".join(parts)}</div>\n'


def _angles(first: FirstPage) -> str:
    head = "".join(f"<th{_right(k > 0)}>{html.escape(c)}</th>" for k, c in enumerate(first.head))
    rows = "".join(
        "<tr>"
        + "".join(f"<td{_right(k > 0)}>{html.escape(c)}</td>" for k, c in enumerate(row))
        + "</tr>"
        for row in first.rows
    )
    items = "".join(f"<li>{html.escape(d.sentence)}.</li>" for d in first.differences)
    several = len(first.head) > 4
    differences = f"<ul>{items}</ul>" if items else f"<p>{_ALIKE}</p>" * several
    return (
        f"<p>{html.escape(first.moment)}:</p>\n"
        f'<div class="wide" tabindex="0" role="region" aria-label="Key angles"><table><thead><tr>'
        f"{head}</tr></thead><tbody>{rows}</tbody></table></div>\n{differences}\n"
    )


def _section(
    folder: Path, part: Section, glossary: dict[str, str], above: Sequence[Picture | None]
) -> str:
    """A section, without the pictures that are above it on the page."""
    sentences = "".join(f"<li>{html.escape(s)}</li>" for s in part.sentences)
    folded = "".join(
        f"<details><summary>{html.escape(p.caption)}</summary>{_figure(folder, p)}</details>\n"
        for p in part.folded_pictures
    ) + "".join(
        f"<details><summary>{html.escape(t.title)}</summary>{html_table(t, glossary)}</details>\n"
        for t in part.folded_tables
    )
    return (
        f'<h2 id="{_anchor(part.title)}">{html.escape(part.title)}</h2>\n'
        + (f"<p>{html.escape(part.lead)}</p>\n" if part.lead else "")
        + (f"<ul>{sentences}</ul>\n" if sentences else "")
        + "".join(html_table(t, glossary) for t in part.tables[:1])
        + "".join(_figure(folder, p) for p in part.pictures if p not in above)
        + "".join(html_table(t, glossary) for t in part.tables[1:])
        + folded
    )


def _figure(folder: Path, picture: Picture) -> str:
    data = base64.b64encode((folder / picture.file).read_bytes()).decode("ascii")
    kind = _MIME.get(Path(picture.file).suffix, "application/octet-stream")
    source = f"data:{kind};base64,{data}"
    text = html.escape(picture.caption)
    drawn = "chart" if kind == _MIME[".png"] else "photo"
    image = (
        f'<div class="wide" tabindex="0"><img class="{drawn}" src="{source}" alt="{text}"></div>'
    )
    return f"<figure>{image}<figcaption>{text}</figcaption></figure>\n"


def _glossary(glossary: dict[str, str]) -> str:
    entries = "".join(
        f'<dt id="{name}">{html.escape(column_title(name))} <code>{name}</code></dt>'
        f"<dd>{html.escape(meaning)}</dd>\n"
        for name, meaning in sorted(glossary.items(), key=lambda entry: column_title(entry[0]))
    )
    return (
        f'<h2 id="{_anchor(_COLUMNS)}">{_COLUMNS}</h2>\n<dl>{entries}</dl>'
        "<p>In full: docs/metrics.md and docs/uncertainty.md. For programs: metrics.json and one "
        "CSV per table.</p>\n"
    )


def _anchor(title: str) -> str:
    return "section-" + "".join(c if c.isalnum() else "-" for c in title.lower())

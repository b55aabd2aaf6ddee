"""The report's page: its sections in order, as HTML with embedded pictures."""

from __future__ import annotations

import base64
import html
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from imocap_core.artifacts.schemas import Table
from imocap_core.artifacts.schemas.motion_schemas import Cell
from imocap_core.diagnostics.findings import Verdict
from imocap_core.evaluate.scoreboard import AFTER_LOOP, MONOCULAR, SINGLE_PASS
from imocap_core.metrics.scoring import ALL_VIDEOS
from imocap_core.report.first_page import ANGLES, FirstPage
from imocap_core.report.page_files import badge, html_head, prose, sentences
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
    return f"<h3>{title}</h3>\n{_wide(title, head, body)}\n{note}"


def _wide(title: str, head: str, body: Sequence[str]) -> str:
    """A table of some cells, which can be scrolled sideways; title: for who does not see it."""
    return (
        f'<div class="wide" tabindex="0" role="region" aria-label="{title}">'
        f"<table><thead><tr>{head}</tr></thead>\n<tbody>{''.join(body)}</tbody></table></div>"
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
    rows = [
        "".join(f"<td{_right(k > 0)}>{html.escape(c)}</td>" for k, c in enumerate(row))
        for row in first.rows
    ]
    table = _wide("Key angles", head, [f"<tr>{row}</tr>" for row in rows])
    items = "".join(f"<li>{html.escape(d.sentence)}.</li>" for d in first.differences)
    several = len(first.head) > 4
    differences = f"<ul>{items}</ul>" if items else f"<p>{_ALIKE}</p>" * several
    return f"<p>{html.escape(first.moment)}:</p>\n{table}\n{differences}\n"


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


_PLAN = tomllib.loads(Path(__file__).with_name("sections.toml").read_text(encoding="utf-8"))
_SENTENCES = "open"  # the table of the observability report's sentences
_PROGRAMS = "metrics"  # the long table, for programs only
_SCORED = "mpjpe_mm"  # a column that is there when the truth is


@dataclass(frozen=True)
class Section:
    """A section of the page, with its content."""

    title: str
    lead: str
    sentences: list[str] = field(default_factory=list)
    pictures: list[Picture] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    folded_pictures: list[Picture] = field(default_factory=list)
    folded_tables: list[Table] = field(default_factory=list)

    @property
    def empty(self) -> bool:
        """Whether there is only a title."""
        parts = (self.sentences, self.pictures, self.tables)
        return not any((*parts, self.folded_pictures, self.folded_tables))


def sections(
    tables: Sequence[Table], pictures: Sequence[Picture], videos: int = 3
) -> list[Section]:
    """The sections in order; content that no plan names comes last. Empty sections are omitted.

    videos: of the action; with one or two of them some introductions differ, and with one there is
    nothing to compare.
    """
    by_name = {t.name: _shown(t, videos) for t in tables if t.name != _PROGRAMS}
    left = list(pictures)
    filled = []
    for plan in _plans_for(by_name, videos):
        opened = _taken(left, plan.get("pictures", ()))
        folded = _taken(left, plan.get("folded", ()))
        named = [by_name.pop(name) for name in plan.get("tables", ()) if name in by_name]
        filled.append(
            Section(
                plan["title"],
                plan["lead"],
                [str(row[0]) for t in named if t.name == _SENTENCES for row in t.rows],
                opened,
                [t for t in named if t.name != _SENTENCES],
                folded,
                [by_name.pop(name) for name in plan.get("folded", ()) if name in by_name],
            )
        )
    filled.append(Section("Other", "", pictures=left, tables=list(by_name.values())))
    return [section for section in filled if not section.empty]


def _plans_for(tables: Mapping[str, Table], videos: int) -> list[dict[str, Any]]:
    """The plans, with the introductions of so few videos; without truth there is no summary, whose
    table then only has what `Motion` shows."""
    few = {1: "lead_of_one", 2: "lead_of_two"}.get(videos, "lead")
    plans = [plan | {"lead": plan.get(few, plan["lead"])} for plan in _PLAN["section"]]
    if _SCORED not in getattr(tables.get("summary"), "columns", [_SCORED]):
        title = "The video" if videos == 1 else "The same moments"
        plans[0] |= {"title": title, "lead": "", "tables": ()}
        motion = next(plan for plan in plans if plan["title"] == "Motion")
        motion["folded"] = ("summary", *motion["folded"])
    return plans


def _shown(table: Table, videos: int) -> Table:
    """A table as the page shows it: the headline columns of the summary, one row a reason of what
    is not scored, no empty columns, and of a single video nothing that compares it with itself."""
    columns, rows = table.columns, table.rows
    if table.name == "unscored":
        metrics: dict[str, list[str]] = {}
        for metric, reason in rows:
            metrics.setdefault(str(reason), []).append(column_title(str(metric)))
        columns = ["reason", "metrics"]
        rows = [[reason, "; ".join(names)] for reason, names in metrics.items()]
    order = list(range(len(columns)))
    if table.name == "summary":
        order = [columns.index(name) for name in _PLAN["headline"] if name in columns]
    shown = [k for k in order if any(row[k] is not None for row in rows)]
    if videos == 1:
        shown = [k for k in shown if columns[k] != "matched_share"]
    rows = [[row[k] for k in shown] for row in rows]
    rows = _of_single_video(rows) if videos == 1 else rows
    return table.model_copy(update={"columns": [columns[k] for k in shown], "rows": rows})


def _of_single_video(rows: Sequence[Sequence[Cell]]) -> list[list[Cell]]:
    """Without rows of the stages before the last, means over all videos, and the reference role."""
    repeated = {MONOCULAR, SINGLE_PASS}
    if any(ALL_VIDEOS not in row for row in rows):
        repeated.add(ALL_VIDEOS)

    def single(cell: Cell) -> Cell:
        if not isinstance(cell, str):
            return cell
        return "result" if cell == AFTER_LOOP else cell.removesuffix(" (reference)")

    return [list(map(single, row)) for row in rows if repeated.isdisjoint(map(str, row))]


def _taken(left: list[Picture], beginnings: Sequence[str]) -> list[Picture]:
    """The pictures whose file names start so, in that order; removed from `left`."""
    taken = [p for beginning in beginnings for p in left if p.file.startswith(beginning)]
    left[:] = [p for p in left if p not in taken]
    return taken

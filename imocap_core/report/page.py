"""The report's page: HTML with embedded pictures, and Markdown that links them."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from imocap_core.artifacts.schemas import Table
from imocap_core.diagnostics.findings import Verdict
from imocap_core.metrics.scoring import ALL_VIDEOS
from imocap_core.report.sections import Section
from imocap_core.report.table_files import GLOSSARY, Contents, Picture, cell_text, column_title


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


STYLE = """
:root {
  --ink: #1d2227; --quiet: #4f5861; --line: #d9dee3; --paper: #ffffff; --accent: #28588a;
  --edge: #8f979f; --target: #f3e6d5; --good: #3d8b5f; --doubt: #c4622d; color-scheme: light dark;
}
@media (prefers-color-scheme: dark) {
  :root {
    --ink: #e6eaee; --quiet: #aab3bd; --line: #343c45; --paper: #171c21; --accent: #86b7ea;
    --edge: #75818d; --target: #44361f; --good: #62b487; --doubt: #e28a55;
  }
  img.chart { filter: invert(.92) hue-rotate(180deg); }
  img.photo { filter: brightness(.88); }
}
* { box-sizing: border-box; }
body {
  font: 15px/1.5 system-ui, "DejaVu Sans", sans-serif; color: var(--ink); background: var(--paper);
  max-width: 1160px; margin: 2.2rem auto 5rem; padding: 0 1.2rem; overflow-wrap: break-word;
}
h1 { font-size: 1.7rem; margin: 0 0 .2rem; }
h2 {
  font-size: 1.25rem; margin: 3rem 0 .4rem; padding-top: .8rem; border-top: 1px solid var(--line);
}
h3 { font-size: .95rem; margin: 1.6rem 0 .4rem; }
p, figcaption, dd { color: var(--quiet); max-width: 80ch; }
li { max-width: 84ch; }
nav { font-size: .88rem; margin: .8rem 0 0; line-height: 2; }
nav a { margin-right: 1.1rem; white-space: nowrap; }
a { color: var(--accent); text-decoration: none; }
a:hover { text-decoration: underline; }
th a { color: inherit; border-bottom: 1px dotted var(--edge); }
.wide { overflow-x: auto; }
.wide:focus-visible { outline: 2px solid var(--accent); }
table { border-collapse: collapse; font-size: .83rem; font-variant-numeric: tabular-nums; }
th, td { padding: .28rem .7rem; text-align: left; border-bottom: 1px solid var(--line); }
th { font-weight: 600; vertical-align: bottom; max-width: 9.5rem; }
td { max-width: 60ch; }
td.n, td:first-child { white-space: nowrap; }
th:first-child, td:first-child { position: sticky; left: 0; background: var(--paper); }
td:first-child:last-child, td:first-child:not(:has(+ .n, + td + .n)) { white-space: normal; }
.n { text-align: right; }
.total td { border-bottom-color: var(--edge); font-weight: 600; }
figure { margin: 1.4rem 0; }
figcaption { font-size: .88rem; }
img { max-width: 100%; height: auto; }
details { margin: 1rem 0; }
summary { cursor: pointer; color: var(--accent); padding: .3rem 0; }
dt { margin-top: .6rem; font-weight: 600; font-size: .9rem; }
dt code { font-weight: 400; font-size: .8rem; color: var(--quiet); margin-left: .4rem; }
dd { margin: 0 0 0 1.2rem; font-size: .88rem; }
dt:target { background: var(--target); }
.verdict p { color: inherit; margin: .5rem 0; font-size: 1.05rem; }
.verdict { border-left: 4px solid var(--good); padding: .1rem 1rem; margin: .8rem 0; }
.doubt { border-left-color: var(--doubt); }
/* On a phone pictures keep a size at which their lettering can be read, and move sideways. */
@media (max-width: 760px) {
  body { font-size: 16px; margin: 1rem auto 3rem; padding: 0 .9rem; }
  .wide { margin: 0 -.9rem; padding: 0 .9rem; }
  .wide img { max-width: none; width: 860px; }
  th, td { padding: .4rem .6rem; }
  table, figcaption, dd { font-size: .9rem; }
  summary { padding: .6rem 0; }
  nav a { display: inline-block; padding: .3rem 0; }
  th:first-child, td:first-child { left: -.9rem; padding-left: .9rem; }
  ul { padding-left: 1.2rem; }
}
"""


MIME = {".png": "image/png", ".jpg": "image/jpeg", ".webp": "image/webp"}
STAMP = "imocap-made-from"
DARK_MEANS = ("affinity.",)  # charts in which dark and light have a meaning: never reversed
COLUMNS = "Glossary of the columns"
DETAILS = "Details of the verdict"


def html_page(
    folder: Path,
    contents: Contents,
    verdict: Verdict,
    parts: Sequence[Section],
    links: Iterable[str],
    stamp: str,
    sources: str = "",
) -> str:
    """One page that needs no other file. `links`: files in the folder that it links to; `sources`:
    which video is which file."""
    titles = [*(p.title for p in parts), COLUMNS]
    nav = " ".join(f'<a href="#{_anchor(title)}">{html.escape(title)}</a>' for title in titles)
    glossary = {c: GLOSSARY[c] for t in _tables(parts) for c in t.columns if c in GLOSSARY}
    beside = "".join(f'<a href="{html.escape(x)}">{html.escape(x)}</a> ' for x in links)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<meta name="{STAMP}" content="{stamp}">'
        f"<title>{html.escape(contents.title)}</title><style>{STYLE}</style></head><body>\n"
        f"<h1>{html.escape(contents.title)}</h1>\n{_verdict(verdict)}"
        + (f"<p>{html.escape(sources)}</p>\n" if sources else "")
        + f"<nav>{nav}</nav>\n"
        + (f"<nav>Beside this page: {beside}</nav>\n" if beside else "")
        + "".join(_section(folder, part, glossary) for part in parts)
        + _glossary(glossary)
        + "</body></html>\n"
    )


def markdown_page(
    contents: Contents, verdict: Verdict, parts: Sequence[Section], sources: str = ""
) -> str:
    """The same as Markdown, nothing folded, for a repository or a terminal."""
    text = [f"# {contents.title}\n", *(f"{sentence}\n" for sentence in verdict.summary)]
    if verdict.findings:
        details = "\n".join(f"* {finding.sentence}" for finding in verdict.findings)
        text.append(f"## {DETAILS}\n\n{details}\n")
    if sources:
        text.append(f"{sources}\n")
    for part in parts:
        text.append(f"## {part.title}\n")
        if part.lead:
            text.append(f"{part.lead}\n")
        if part.sentences:
            text.append("\n".join(f"* {sentence}" for sentence in part.sentences) + "\n")
        pictures = (*part.pictures, *part.folded_pictures)
        text += [f"![{p.caption}]({p.file})\n\n{p.caption}\n" for p in pictures]
        text += [markdown(table) for table in (*part.tables, *part.folded_tables)]
    return "\n".join(text)


def _verdict(verdict: Verdict) -> str:
    """The three sentences, and behind a click the findings."""
    style = "verdict" if verdict.trusted else "verdict doubt"
    summary = "".join(f"<p>{html.escape(sentence)}</p>" for sentence in verdict.summary)
    findings = "".join(f"<li>{html.escape(f.sentence)}</li>" for f in verdict.findings)
    details = f"<details{' open' * (not verdict.trusted)}><summary>{DETAILS}</summary>"
    details += f"<ul>{findings}</ul></details>\n"
    return f'<div class="{style}">{summary}</div>\n' + (details if findings else "")


def _section(folder: Path, part: Section, glossary: dict[str, str]) -> str:
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
        + "".join(_figure(folder, p) for p in part.pictures)
        + "".join(html_table(t, glossary) for t in part.tables[1:])
        + folded
    )


def _figure(folder: Path, picture: Picture) -> str:
    data = base64.b64encode((folder / picture.file).read_bytes()).decode("ascii")
    kind = MIME.get(Path(picture.file).suffix, "application/octet-stream")
    source = f"data:{kind};base64,{data}"
    text = html.escape(picture.caption)
    reversible = kind == MIME[".png"] and not picture.file.startswith(DARK_MEANS)
    drawn = "chart" if reversible else "photo"
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
        f'<h2 id="{_anchor(COLUMNS)}">{COLUMNS}</h2>\n<dl>{entries}</dl>'
        "<p>In full: docs/metrics.md and docs/uncertainty.md. For programs: metrics.json and one "
        "CSV per table.</p>\n"
    )


def _tables(parts: Iterable[Section]) -> list[Table]:
    return [table for part in parts for table in (*part.tables, *part.folded_tables)]


def _anchor(title: str) -> str:
    return "section-" + "".join(c if c.isalnum() else "-" for c in title.lower())

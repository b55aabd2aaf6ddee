"""The report's page: HTML with embedded pictures, and Markdown that links them."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence
from pathlib import Path

from imocap_core.artifacts.schemas import Table
from imocap_core.report.column_titles import column_title
from imocap_core.report.files import Contents, Picture
from imocap_core.report.metric_glossary import GLOSSARY
from imocap_core.report.page_style import STYLE
from imocap_core.report.sections import Section
from imocap_core.report.table_markup import html_table, markdown
from imocap_core.verdict.findings import Verdict

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

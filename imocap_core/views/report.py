"""The report folder: tables for people and programs, figures, and one page that shows them."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from imocap_core.artifacts.schemas import Table
from imocap_core.views import tables as text

STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.5 system-ui, sans-serif; color: #22262b; background: #fff;
       max-width: 1120px; margin: 2.5rem auto; padding: 0 1.2rem; }
h1 { font-size: 1.5rem; margin-bottom: .2rem; }
h2 { font-size: 1.05rem; margin: 2.2rem 0 .5rem; }
p, figcaption { color: #5d656e; max-width: 75ch; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .83rem; font-variant-numeric: tabular-nums; }
th, td { padding: .28rem .7rem; text-align: left; border-bottom: 1px solid #e4e7ea; }
th { font-weight: 600; vertical-align: bottom; }
.n { text-align: right; }
.total td { border-bottom-color: #868d96; font-weight: 600; }
figure { margin: 1.6rem 0; }
img { max-width: 100%; height: auto; }
"""


@dataclass(frozen=True)
class Picture:
    """A figure's file, relative to the report, and what it shows."""

    file: str
    caption: str


def write_report(
    folder: Path,
    title: str,
    lead: str,
    tables: Sequence[Table],
    every: Table,
    pictures: Sequence[Picture],
) -> list[str]:
    """Write index.html, report.md, metrics.json and one CSV a table; returns the file names.

    Args:
        lead: one sentence under the title. tables: shown on the page. every: the long table, for
            programs only. pictures: files that lie in the folder already.
    """
    files = {
        "index.html": _page(title, lead, tables, pictures),
        "report.md": _markdown(title, lead, tables, pictures),
        "metrics.json": text.json_text([*tables, every]),
        **{f"{table.name}.csv": text.csv_text(table) for table in (*tables, every)},
    }
    for name, content in files.items():
        (folder / name).write_text(content, encoding="utf-8", newline="\n")
    return sorted([*files, *(picture.file for picture in pictures)])


def _page(title: str, lead: str, tables: Sequence[Table], pictures: Sequence[Picture]) -> str:
    figures = "".join(
        f'<figure><img src="{html.escape(p.file)}" alt="{html.escape(p.caption)}" loading="lazy">'
        f"<figcaption>{html.escape(p.caption)}</figcaption></figure>\n"
        for p in pictures
    )
    summary, rest = tables[:1], tables[1:]
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width">'
        f"<title>{html.escape(title)}</title><style>{STYLE}</style></head><body>\n"
        f"<h1>{html.escape(title)}</h1>\n<p>{html.escape(lead)}</p>\n"
        f"{_sections(summary)}{figures}{_sections(rest)}"
        f"<p>Numbers for programs: metrics.json, and a CSV for each table. "
        f"What each metric means: docs/metrics.md.</p>\n</body></html>\n"
    )


def _sections(tables: Sequence[Table]) -> str:
    return "".join(f'<div class="wide">{text.html_table(table)}</div>\n' for table in tables)


def _markdown(title: str, lead: str, tables: Sequence[Table], pictures: Sequence[Picture]) -> str:
    shown = [f"![{p.caption}]({p.file})\n\n{p.caption}\n" for p in pictures]
    parts = [f"# {title}\n\n{lead}\n", *map(text.markdown, tables), *shown]
    return "\n".join(parts)

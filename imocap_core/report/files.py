"""What a report is made of, as files: tables for programs, and an index of tables and pictures."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from imocap_core.artifacts.schemas import Table
from imocap_core.report import tables as text

CONTENTS = "contents.json"


@dataclass(frozen=True)
class Picture:
    """A figure's file, relative to the report, and what it shows."""

    file: str
    caption: str


@dataclass(frozen=True)
class Contents:
    """What the report's page is about: its title, one sentence, its pictures."""

    title: str
    lead: str
    pictures: tuple[Picture, ...]


def write_report(
    folder: Path,
    title: str,
    lead: str,
    tables: Sequence[Table],
    every: Table,
    pictures: Sequence[Picture],
) -> list[str]:
    """Write contents.json, metrics.json and one CSV a table; returns the file names. The page
    itself is made of these by `imocap_core.report.page`.

    Args:
        lead: one sentence under the title. tables: shown on the page. every: the long table, for
            programs only. pictures: files that lie in the folder already.
    """
    contents = asdict(Contents(title, lead, tuple(pictures)))
    files = {
        CONTENTS: json.dumps(contents, indent=1, ensure_ascii=False) + "\n",
        "metrics.json": text.json_text([*tables, every]),
        **{f"{table.name}.csv": text.csv_text(table) for table in (*tables, every)},
    }
    for name, content in files.items():
        (folder / name).write_text(content, encoding="utf-8", newline="\n")
    return sorted([*files, *(picture.file for picture in pictures)])


def read_contents(folder: Path) -> Contents:
    """What `write_report` wrote. OSError or ValueError when it can't be read."""
    said = json.loads((folder / CONTENTS).read_text(encoding="utf-8"))
    pictures = tuple(Picture(p["file"], p["caption"]) for p in said["pictures"])
    return Contents(said["title"], said["lead"], pictures)

"""The report's files for programs: tables as CSV and JSON, and an index of its pictures."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from imocap_core.artifacts.schemas import Table
from imocap_core.artifacts.side_files import check_names
from imocap_core.errors import CONTROL
from imocap_core.report import table_text

CONTENTS = "contents.json"


@dataclass(frozen=True)
class Picture:
    """A figure's file, relative to the report, and its caption."""

    file: str
    caption: str


@dataclass(frozen=True)
class Contents:
    """The head of the report's page: its title and its pictures."""

    title: str
    pictures: tuple[Picture, ...]


def write_report(
    folder: Path,
    title: str,
    tables: Sequence[Table],
    every: Table,
    pictures: Sequence[Picture],
) -> list[str]:
    """Write contents.json, metrics.json and one CSV per table; returns the file names.

    Args:
        tables: shown on the page. every: the long table, for programs only. pictures: files that
            are in the folder already.
    """
    contents = asdict(Contents(title, tuple(pictures)))
    files = {
        CONTENTS: json.dumps(contents, indent=1, ensure_ascii=False) + "\n",
        "metrics.json": table_text.json_text([*tables, every]),
        **{f"{table.name}.csv": table_text.csv_text(table) for table in (*tables, every)},
    }
    for name, content in files.items():
        (folder / name).write_text(content, encoding="utf-8", newline="\n")
    return sorted([*files, *(picture.file for picture in pictures)])


def read_contents(folder: Path) -> Contents:
    """The contents that `write_report` wrote. OSError or ValueError when they cannot be read."""
    file = folder / CONTENTS
    try:
        fields = json.loads(file.read_text(encoding="utf-8"))
        pictures = tuple(Picture(str(p["file"]), str(p["caption"])) for p in fields["pictures"])
        check_names(picture.file for picture in pictures)
        title = str(fields["title"])
        if any(CONTROL.search(text) for text in (title, *(p.caption for p in pictures))):
            raise ValueError
        return Contents(title, pictures)
    except (ValueError, LookupError, TypeError, RecursionError):
        raise ValueError(f"{file} is not as the run wrote it; run the action again") from None

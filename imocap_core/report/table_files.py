"""The report's files for programs, tables as CSV and JSON, and their columns in words."""

from __future__ import annotations

import csv
import io
import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from pydantic import TypeAdapter

from imocap_core.artifacts.schemas import Table
from imocap_core.artifacts.schemas.motion_schemas import Cell
from imocap_core.artifacts.side_files import check_names
from imocap_core.errors import CONTROL

_COLUMNS = tomllib.loads(Path(__file__).with_name("columns.toml").read_text(encoding="utf-8"))
_TITLES: dict[str, str] = _COLUMNS["titles"]
GLOSSARY: dict[str, str] = _COLUMNS["glossary"]
METRICS_OF: dict[str, tuple[str, ...]] = {t: tuple(m) for t, m in _COLUMNS["metrics"].items()}

Row = dict[str, Cell]  # by column


def table_of(name: str, rows: Sequence[Mapping[str, Cell]], note: str = "") -> Table:
    """A table with its title, of rows with the same columns in the same order; note: else the one
    that it always has."""
    return Table(
        name=name,
        title=_COLUMNS["tables"][name],
        columns=list(rows[0]) if rows else [],
        rows=[list(row.values()) for row in rows],
        note=note or _COLUMNS["notes"].get(name, ""),
    )


def column_title(name: str) -> str:
    """A column's name in words, its unit in brackets: "joint error, aligned (mm)"."""
    if name in _TITLES:
        return _TITLES[name]
    for end, unit in _COLUMNS["units"].items():
        stem = name.removesuffix(end)
        if stem != name:
            return f"{_TITLES.get(stem, stem.replace('_', ' '))} ({unit})"
    return name.replace("_", " ")


def cell_text(column: str, value: Cell) -> str:
    """A cell's text, rounded by the unit that ends the column's name."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else ""
    if isinstance(value, float):
        return f"{value:.{_COLUMNS['decimals'].get(column.rsplit('_', 1)[-1], 3)}f}"
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
    folder: Path, title: str, tables: Sequence[Table], every: Table, pictures: Sequence[Picture]
) -> list[str]:
    """Write contents.json, metrics.json and one CSV per table; returns the file names.

    Args:
        tables: shown on the page. every: the long table, for programs only. pictures: files that
            are in the folder already.
    """
    contents = asdict(Contents(title, tuple(pictures)))
    files = {
        CONTENTS: json.dumps(contents, indent=1, ensure_ascii=False) + "\n",
        "metrics.json": json_text([*tables, every]),
        **{f"{table.name}.csv": csv_text(table) for table in (*tables, every)},
    }
    for name, content in files.items():
        (folder / name).write_text(content, encoding="utf-8", newline="\n")
    return sorted([*files, *(picture.file for picture in pictures)])


def read_contents(folder: Path) -> Contents:
    """The contents that `write_report` wrote. OSError or ValueError when they cannot be read."""
    file = folder / CONTENTS
    try:
        contents = TypeAdapter(Contents).validate_json(file.read_bytes())
        check_names(picture.file for picture in contents.pictures)
        texts = (contents.title, *(picture.caption for picture in contents.pictures))
        if any(CONTROL.search(text) for text in texts):
            raise ValueError
        return contents
    except ValueError:
        raise ValueError(f"{file} is not as the run wrote it; run the action again") from None

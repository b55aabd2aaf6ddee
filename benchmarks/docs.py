"""Measured tables in the documentation: replaced by the command that measured them.

<!-- table trials-fine_tuned-4v -->
... the last measured table ...
<!-- end -->

A report's title, and what follows its line `tables.DETAILS`, stay in the report's own file.
"""

from __future__ import annotations

import re
from pathlib import Path

from benchmarks.tables import DETAILS
from imocap_core.errors import WrongUse

PAGES = (Path("docs/measurements.md"), Path("README.md"))
END = "<!-- end -->"


def check_marks(root: Path, name: str) -> None:
    """WrongUse, before anything is measured, when no page has a place for the table."""
    if not pages_of(root, name):
        raise WrongUse(
            f"--docs: no page has a place for this table; put the two lines `{_begin(name)}` and "
            f"`{END}` into {root / PAGES[0]}"
        )


def pages_of(root: Path, name: str) -> list[Path]:
    """The pages with the marks of this table."""
    files = [root / page for page in PAGES if (root / page).is_file()]
    return [file for file in files if _block(name).search(file.read_text(encoding="utf-8"))]


def put_into_docs(root: Path, name: str, report: str) -> list[Path]:
    """Replace the table in every page that has its marks; the pages."""
    pages = pages_of(root, name)
    for page in pages:
        text = replaced(page.read_text(encoding="utf-8"), name, essentials(report))
        page.write_text(text, encoding="utf-8")
    return pages


def docs_sentences(root: Path, name: str, report: str) -> list[str]:
    """Put the table into the documentation; one sentence for each file written."""
    return [f"Put into {file}" for file in put_into_docs(root, name, report)]


def essentials(report: str) -> str:
    """What the documentation shows of a report, its headings one level down."""
    shown = report.partition(DETAILS)[0].strip()
    without_title = re.sub(r"\A# .*\n+", "", shown)
    return re.sub(r"^(#+ )", r"#\1", without_title, flags=re.M)


def replaced(page: str, name: str, text: str) -> str:
    """The page with the block of `name` replaced; unchanged when it has no such block."""
    return _block(name).sub(lambda _: f"{_begin(name)}\n\n{text.strip()}\n\n{END}", page)


def _begin(name: str) -> str:
    return f"<!-- table {name} -->"


def _block(name: str) -> re.Pattern[str]:
    return re.compile(re.escape(_begin(name)) + r"(?:(?!<!-- table ).)*?" + re.escape(END), re.S)

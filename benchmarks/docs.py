"""Measured tables in the documentation: replaced by the command that measured them.

<!-- table trials-fine_tuned-4v -->
... the last measured table ...
<!-- end -->
"""

from __future__ import annotations

import re
from pathlib import Path

from imocap_core.errors import WrongUse

PAGES, FRONT = Path("docs/measurements"), Path("README.md")
END = "<!-- end -->"


def check_marks(root: Path, name: str) -> None:
    """WrongUse, before anything is measured, when no page has a place for the table."""
    if page_of(root, name) is None:
        raise WrongUse(
            f"--docs: no page in {root / PAGES} has a place for this table; put the two lines "
            f"`{_begin(name)}` and `{END}` into one of them"
        )


def page_of(root: Path, name: str) -> Path | None:
    """The page of measurements with the marks of this table; None when there is none."""
    for page in sorted((root / PAGES).glob("*.md")):
        if _block(name).search(page.read_text(encoding="utf-8")) is not None:
            return page
    return None


def put_into_docs(root: Path, name: str, table: str, summary: str) -> list[Path]:
    """Replace the page's block by the table, and the README's by the summary if it has one."""
    page = page_of(root, name)
    texts = [] if page is None else [(page, _one_level_down(table))]
    written = []
    for file, text in [*texts, (root / FRONT, summary)]:
        before = file.read_text(encoding="utf-8") if file.is_file() else ""
        after = replaced(before, name, text)
        if after is not None:
            file.write_text(after, encoding="utf-8")
            written.append(file)
    return written


def docs_sentences(root: Path, name: str, table: str, summary: str) -> list[str]:
    """Put the table into the documentation; one sentence for each file written."""
    return [f"Put into {file}" for file in put_into_docs(root, name, table, summary)]


def replaced(page: str, name: str, text: str) -> str | None:
    """The page with the block of `name` replaced; None when it has no such block."""
    block = _block(name)
    if block.search(page) is None:
        return None
    return block.sub(lambda _: f"{_begin(name)}\n\n{text.strip()}\n\n{END}", page)


def _begin(name: str) -> str:
    return f"<!-- table {name} -->"


def _block(name: str) -> re.Pattern[str]:
    return re.compile(re.escape(_begin(name)) + r"(?:(?!<!-- table ).)*?" + re.escape(END), re.S)


def _one_level_down(table: str) -> str:
    return re.sub(r"^(#+ )", r"#\1", table, flags=re.M)

"""Measured tables in the documentation, each between two marks, and what is derived from them.

<!-- table trials-fine_tuned-4v -->
... the last measured table ...
<!-- end -->

`python -m benchmarks.measure` puts its records there. `headline` and `summary` are made of the
tables of docs/measurements.md, so that README.md has no figure that does not stand there. A
report's title, and what follows its line `tables.DETAILS`, stay in the report's own file.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from benchmarks.tables import ABSENT, DETAILS, markdown_table

MEASUREMENTS, README = Path("docs/measurements.md"), Path("README.md")
PAGES = (MEASUREMENTS, README, Path("docs/robustness.md"))
END = "<!-- end -->"

PROTOCOL = "protocol-released-fine_tuned-4v"
RESULTS = ("monocular", "single pass", "after loop", "oracle", "gap closed %")
AFTER = ("P-MPJPE, after loop", "sync %, after loop", "cameras °")
# Rows of the derived tables: what it is, the table, and its row there.
ROWS = (
    ("*balance_beam*: real, four phones", "real", "balance_beam"),
    ("the same from pixels", "real", "balance_beam_pixels"),
    ("*crowd*: real, people in the way", "real", "crowd"),
    ("*yoga*: made, four performances", "yoga", "yoga"),
    ("`protocol`: captured, resampled as in the paper", PROTOCOL, "**mean**"),
    ("`trials`: captured, every video another performance", "trials-fine_tuned-4v", "**mean**"),
    ("`rendered`: the same rendered and detected", "rendered-4v", "**mean**"),
)  # fmt: skip
ASIDE = ("yoga", "balance_beam_pixels")  # not on the front page
# The paper's Tables 1 and 2: Human3.6M, one motion resampled, four videos.
PAPER = ("the paper, on Human3.6M", "80.7", "66.5", ABSENT, "50.3", "0.77")


def put(root: Path, tables: Mapping[str, str]) -> None:
    """Put tables, by name, and what is derived from them into every page with their marks."""
    for page, text in _pages(root, tables).items():
        (root / page).write_text(text, encoding="utf-8")


def stale(root: Path, tables: Mapping[str, str]) -> list[Path]:
    """The pages that `put` would change."""
    pages = _pages(root, tables)
    return [page for page, text in pages.items() if (root / page).read_text("utf-8") != text]


def essentials(report: str) -> str:
    """What the documentation shows of a report, its headings one level down."""
    shown = report.partition(DETAILS)[0].strip()
    without_title = re.sub(r"\A# .*\n+", "", shown)
    return re.sub(r"^(#+ )", r"#\1", without_title, flags=re.M)


def replaced(page: str, name: str, text: str) -> str:
    """The page with the block of `name` replaced; unchanged when it has no such block."""
    return _block(name).sub(lambda _: f"{_begin(name)}\n\n{text.strip()}\n\n{END}", page)


def rows_of(page: str, name: str) -> dict[str, dict[str, str]]:
    """The rows of a block's first table by their first cell; each by its columns."""
    block = _block(name).search(page)
    lines = [line for line in (block[0] if block else "").splitlines() if line.startswith("|")]
    table = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    head = table[0] if table else []
    return {row[0]: dict(zip(head, row, strict=True)) for row in table[2:] if len(row) == len(head)}


def summary(page: str) -> str:
    """Every measured action or mean, from the tables of docs/measurements.md."""
    columns = (*RESULTS, *AFTER)
    head = ("", *RESULTS, "P-MPJPE", "sync %", "cameras °")
    cells = [[what, *(_number(row, c) for c in columns)] for what, row in _measured(page)]
    return markdown_table(head, cells)


def headline(page: str) -> str:
    """The table of the front page: the same, the paper's own figures, and real clips."""
    columns = ("monocular", "after loop", "oracle", *AFTER[:2])
    head = ("", *columns[:3], "P-MPJPE", "sync %")
    shown = _measured(page, ASIDE)
    cells = [[what, *(_number(row, c) for c in columns)] for what, row in shown]
    table = markdown_table(head, [*cells, PAPER])
    return "\n\n".join([table, *_of_real_clips(page)])


def _of_real_clips(page: str) -> list[str]:
    """Sentences on clips without a reference; none where they were not measured."""
    field, penn = (rows_of(page, name).get("all", {}) for name in ("field", "penn"))
    sentences = []
    if field:
        sentences.append(
            f"Of {field['of']} known facts of real exercises and throws {field['right']} come out "
            "right (`field`)."
        )
    if penn:
        sentences.append(
            f"In {penn['groups']} sets of four real clips the others predict a left-out video's "
            f"keypoints to {penn['left out, % of height']} % of the height (`penn`)."
        )
    return [" ".join(sentences)] if sentences else []


def _measured(page: str, without: Sequence[str] = ()) -> list[tuple[str, dict[str, str]]]:
    rows = [(what, key, rows_of(page, name).get(key)) for what, name, key in ROWS]
    return [(what, row) for what, key, row in rows if row and key not in without]


def _number(row: Mapping[str, str], column: str) -> str:
    """A mean without its standard error; `rendered` has shorter names for two columns."""
    return (row.get(column) or row.get(column.partition(",")[0]) or ABSENT).split(" ± ")[0]


def _pages(root: Path, tables: Mapping[str, str]) -> dict[Path, str]:
    """The text of every page with these tables in it."""
    pages = {page: (root / page).read_text("utf-8") for page in PAGES if (root / page).is_file()}
    for name, text in tables.items():
        pages = {page: replaced(old, name, text) for page, old in pages.items()}
    measured = pages.get(MEASUREMENTS, "")
    for name, derived in (("summary", summary), ("headline", headline)):
        text = derived(measured)
        pages = {page: replaced(old, name, text) for page, old in pages.items()}
    return pages


def _begin(name: str) -> str:
    return f"<!-- table {name} -->"


def _block(name: str) -> re.Pattern[str]:
    return re.compile(re.escape(_begin(name)) + r"(?:(?!<!-- table ).)*?" + re.escape(END), re.S)

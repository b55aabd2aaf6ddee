"""The tables of `imocap benchmark wrong_start`."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.rendered.names import is_rendered
from benchmarks.tables import DETAILS, markdown_table, missing_sentence
from benchmarks.wrong_start.hypotheses import HypothesisRow
from benchmarks.wrong_start.hypotheses import summary as hypothesis_summary
from benchmarks.wrong_start.measure import WrongStartRow, summary

TITLES = (("From keypoints", False), ("Rendered, from pixels", True))


def markdown(
    rows: Sequence[WrongStartRow], motions: Sequence[HypothesisRow], missing: Sequence[str]
) -> str:
    """The whole report; missing: actions that were to be run and are not in it."""
    if not rows:
        return missing_sentence(missing).strip() + "\n"
    parts = []
    for title, of_pixels in TITLES:
        part = [row for row in rows if is_rendered(row.action) == of_pixels]
        if part:
            among = [row for row in motions if is_rendered(row.action) == of_pixels]
            parts.append(f"{_summary(title, part)}; {hypothesis_summary(among)}.")
    if missing:
        parts.append(missing_sentence(missing).strip())
    return "\n\n".join([*parts, DETAILS, _results(rows)]) + "\n"


def _summary(title: str, rows: Sequence[WrongStartRow]) -> str:
    count = len({row.action for row in rows})
    return f"{title}, {count} {'action' if count == 1 else 'actions'}: {summary(rows)}"


def _results(rows: Sequence[WrongStartRow]) -> str:
    body = [
        [
            row.action,
            row.views,
            row.starts,
            *(
                f"{mm:.1f}"
                for mm in (row.monocular_mm, row.wrong_mm, row.view_mm)
                + (row.undisturbed_mm, row.result_mm)
            ),
            f"{100 * (row.result_mm / row.undisturbed_mm - 1):+.1f}",
            row.excluded or "none",
            row.flipped or "none",
            "yes" if row.recovered else "no",
        ]
        for row in rows
    ]
    head = ["action", "views", "started wrong", "monocular (mm)", "wrong", "after the loop"]
    head += ["all views undisturbed", "all views", "change %", "excluded", "flipped", "recovered"]
    return markdown_table(head, body)

"""The table of `imocap benchmark screening`: shares over development, held-out and all scenes."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from benchmarks.screening.measure import SceneRow
from benchmarks.tables import markdown_table

Counts = tuple[int, int]  # how many of how many


def screening_table(rows: Sequence[SceneRow]) -> str:
    """The counts as Markdown, one column for each half of the scenes and one for all."""
    halves = [
        [row for row in rows if row.development],
        [row for row in rows if not row.development],
        list(rows),
    ]
    body = [[what, *(_cell(count(half)) for half in halves)] for what, count in MEASURES.items()]
    return markdown_table(["", "development", "held out", "all"], body)


def genuine_treated(rows: Sequence[SceneRow]) -> Counts:
    """Genuine videos excluded or flipped, in all three variants of the scenes."""
    videos = sum(row.videos + 2 * (row.videos - 1) for row in rows)
    return sum(row.wrongly_treated for row in rows), videos


def clean_treated(rows: Sequence[SceneRow]) -> Counts:
    """The same, in clean scenes alone."""
    return sum(r.clean_excluded + r.clean_flipped for r in rows), sum(r.videos for r in rows)


def strangers_excluded(rows: Sequence[SceneRow]) -> Counts:
    """Strangers excluded."""
    return sum(row.stranger in row.stranger_excluded.split() for row in rows), len(rows)


def mirrored_flipped(rows: Sequence[SceneRow]) -> Counts:
    """Mirrored videos flipped, of asymmetric actions."""
    able = [row for row in rows if row.asymmetric]
    return sum(row.mirrored in row.mirrored_flipped.split() for row in able), len(able)


def near_symmetric_flipped(rows: Sequence[SceneRow]) -> Counts:
    """Videos of near-symmetric actions flipped, mirrored or not."""
    near = [row for row in rows if not row.asymmetric]
    flips = sum(row.near_symmetric_flips for row in near)
    return flips, sum(3 * row.videos for row in near)


def mirrored_excluded(rows: Sequence[SceneRow]) -> Counts:
    """Mirrored videos excluded as another action."""
    return sum(row.mirrored in row.mirrored_excluded.split() for row in rows), len(rows)


MEASURES: dict[str, Callable[[Sequence[SceneRow]], Counts]] = {
    "genuine videos excluded or flipped": genuine_treated,
    "of these in clean scenes": clean_treated,
    "strangers excluded": strangers_excluded,
    "mirrored videos of asymmetric actions flipped": mirrored_flipped,
    "mirrored videos excluded": mirrored_excluded,
    "videos of near-symmetric actions flipped": near_symmetric_flipped,
}


def _cell(counts: Counts) -> str:
    part, whole = counts
    return f"{part} of {whole} ({100 * part / whole:.1f} %)" if whole else "–"

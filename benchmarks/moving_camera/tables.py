"""The tables of `imocap benchmark moving_camera`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.moving_camera.films import KINDS, FilmRow
from benchmarks.moving_camera.motions import CASES, METRICS, MotionRow
from benchmarks.tables import cell, markdown_table

WORDS = {
    "walks": "walks 0.5 to 2 m and turns",
    "turns": "turns on a tripod",
    "shakes": "turns and shakes on a spot",
    "zooms": "turns and zooms",
}


def markdown(films: Sequence[FilmRow], motions: Sequence[MotionRow]) -> str:
    """The parts that were measured."""
    parts = ([_films(films)] if films else []) + ([_motions(motions)] if motions else [])
    return "\n\n".join(parts) + "\n"


def _films(films: Sequence[FilmRow]) -> str:
    body = []
    for kind in KINDS:
        rows = [row for row in films if row.kind == kind]
        if not rows:
            continue
        moving = sum(row.verdict in ("found", "flat") for row in rows)
        untested = sum(row.verdict == "untested" for row in rows)
        paths = [row for row in rows if np.isfinite(row.path_mm)]
        body.append(
            [
                WORDS[kind],
                str(len(rows)),
                f"{moving} ({100 * moving / len(rows):.0f} %)",
                str(untested),
                cell(float(np.median([row.off_px for row in rows])), 2),
                *_paths(paths),
            ]
        )
    head = ["camera", "films", "called moving", "untested", "off a tripod (px)", "paths"]
    head += ["path error, median (mm)", "worst", "focal error, median (%)"]
    return markdown_table(head, body)


def _paths(rows: Sequence[FilmRow]) -> list[str]:
    if not rows:
        return ["–"] * 4
    errors = [row.path_mm for row in rows]
    focal = [abs(row.focal_pct) for row in rows]
    return [
        str(len(rows)),
        cell(float(np.median(errors)), 1),
        cell(max(errors), 1),
        cell(float(np.median(focal)), 1),
    ]


def _motions(motions: Sequence[MotionRow]) -> str:
    body = []
    for case in CASES:
        rows = [row for row in motions if row.case == case]
        if rows:
            means = [float(np.mean([row.numbers[m] for row in rows])) for m in METRICS]
            paths = [
                float(np.mean([getattr(row, f) for row in rows])) for f in ("path_mm", "unit_pct")
            ]
            body.append([case, str(len(rows)), *(cell(x, 1) for x in (*means, *paths))])
    head = ["cameras", "actions", *(m.removesuffix("_mm") for m in METRICS)]
    return markdown_table([*head, "path (mm)", "unit (%)"], body)

"""Reliability diagrams: the share that is right over the claimed confidence, one panel a kind."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Shaped

from benchmarks.sync_reliability import expected_calibration_error
from tools.svg import INK, PALE, PAPER, SANS, box, text

PANEL, GAP, COLUMNS, BINS = 130.0, 46.0, 5, 10
LEAST = 30  # frames of a bin that is drawn
BLUE, GREY = "#3b82f6", "#9ca3af"


def write_reliability(
    file: Path,
    confidence: Float[np.ndarray, " n"],
    right: Bool[np.ndarray, " n"],
    kinds: Shaped[np.ndarray, " n"],
    order: Sequence[str],
) -> None:
    """Write the diagram of each kind to an SVG file."""
    rows = -(-len(order) // COLUMNS)
    wide, high = COLUMNS * (PANEL + GAP) + GAP, rows * (PANEL + GAP) + GAP
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {wide:g} {high:g}" '
        f'font-family="{SANS}">',
        box(0, 0, wide, high, PAPER, PAPER, 0),
    ]
    for k, kind in enumerate(order):
        x, y = GAP + (k % COLUMNS) * (PANEL + GAP), GAP + (k // COLUMNS) * (PANEL + GAP)
        of_kind = kinds == kind
        parts += _panel(x, y, kind, confidence[of_kind], right[of_kind])
    file.write_text("\n".join([*parts, "</svg>"]) + "\n")


def _panel(x: float, y: float, kind: str, confidence: np.ndarray, right: np.ndarray) -> list[str]:
    error = expected_calibration_error(confidence, right)
    parts = [
        box(x, y, PANEL, PANEL, PAPER, GREY, 1, 0),
        f'<path d="M{x:g} {y + PANEL:g}L{x + PANEL:g} {y:g}" stroke="{GREY}" '
        'stroke-dasharray="3 3"/>',
        text(x, y - 8, f"{kind}: {error:.3f}", 11, INK),
        text(x, y + PANEL + 13, "0", 9, PALE),
        text(x + PANEL, y + PANEL + 13, "claimed 1", 9, PALE, anchor="end"),
    ]
    bins = np.minimum((confidence * BINS).astype(int), BINS - 1)
    points = []
    for b in range(BINS):
        inside = bins == b
        if inside.sum() >= LEAST:
            place = (x + PANEL * confidence[inside].mean(), y + PANEL * (1 - right[inside].mean()))
            radius = 2 + 4 * np.sqrt(inside.mean())
            points.append(place)
            parts.append(
                f'<circle cx="{place[0]:.1f}" cy="{place[1]:.1f}" r="{radius:.1f}" fill="{BLUE}"/>'
            )
    way = "L".join(f"{a:.1f} {b:.1f}" for a, b in points)
    if points:
        parts.append(f'<path d="M{way}" stroke="{BLUE}" fill="none"/>')
    return parts

"""Shapes of a drawing as lines of SVG."""

from __future__ import annotations

import re
import textwrap
from html import escape

INK, PALE, PAPER = "#1f2937", "#6b7280", "#ffffff"
SANS = "system-ui, -apple-system, 'Segoe UI', 'DejaVu Sans', sans-serif"
MONO = "ui-monospace, 'SF Mono', Menlo, 'DejaVu Sans Mono', monospace"


def fitted(sentence: str, chars: int, lines: int) -> list[str]:
    """The sentence, or as much of it up to a comma, colon or bracket as these lines take."""
    ends = [m.start() for m in re.finditer(r"[,:;.]? \(|[,:;] ", sentence)] + [len(sentence)]
    for end in sorted(ends, reverse=True):
        wrapped = textwrap.wrap(sentence[:end], chars)
        if len(wrapped) <= lines:
            return wrapped
    return textwrap.wrap(sentence, chars, max_lines=lines, placeholder=" …")


def text(
    x: float, y: float, words: str, size: float, color: str = INK, *, anchor: str = "start",
    weight: int = 400, style: str = "normal", family: str = "", kind: str = "",
) -> str:  # fmt: skip
    """One line of letters; `kind` becomes its class, for whoever reads the drawing."""
    extra = f' text-anchor="{anchor}"' if anchor != "start" else ""
    extra += f' font-weight="{weight}"' if weight != 400 else ""
    extra += f' font-style="{style}"' if style != "normal" else ""
    extra += f' font-family="{family}"' if family else ""
    extra += f' class="{kind}"' if kind else ""
    return (
        f'<text x="{x:g}" y="{y:g}" font-size="{size}" fill="{color}"{extra}>{escape(words)}</text>'
    )


def box(
    x: float, y: float, wide: float, high: float, fill: str, edge: str, line: float, r: float = 9
) -> str:
    """A rounded rectangle."""
    return (
        f'<rect x="{x:g}" y="{y:g}" width="{wide:g}" height="{high:g}" rx="{r:g}" fill="{fill}" '
        f'stroke="{edge}" stroke-width="{line}"/>'
    )


def arrow(x0: float, y0: float, x1: float, y1: float) -> str:
    """From left to right, with a bend in the middle where the heights differ."""
    way = f"H{x1 - 5:g}" if y0 == y1 else f"H{(x0 + x1) / 2:g}V{y1:g}H{x1 - 5:g}"
    return (
        f'<path d="M{x0:g} {y0:g}{way}" stroke="{PALE}" stroke-width="1.6" fill="none"/>'
        f'<path d="M{x1:g} {y1:g}l-7 -4v8z" fill="{PALE}"/>'
    )

"""Where a part of a clip occurs again in it: warped matches, then the best choice of matches that
don't overlap.

The clip is followed and preceded by samples of worth 0, so that an occurrence may run over the
clip's ends: half a repetition there is explained, but is no repetition.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Span = tuple[int, int]

WHOLE_SHARE = 0.85  # an occurrence of which this much lies in the clip is not cut off


@dataclass(frozen=True)
class Template:
    """spans: first and one past the last sample of each whole occurrence, the template's own among
    them. explained: samples of the clip that the others and those cut off at the clip's ends cover,
    each times its worth; whole: without those cut off."""

    samples: int
    spans: tuple[Span, ...]
    explained: float
    whole: float


def matches(worth: Array) -> tuple[Array, Ints]:
    """How well a template's beginning, of every length, matches at each place of a clip.

    `worth` (n, N), template samples by clip samples: 1 for equal poses, 0 and less for unlike ones.
    Returns, both (n, N): the largest sum of `worth` over a warp of template samples 0 to k whose
    last one is matched to e, and what sample 0 is matched to. A warp goes on by one or two samples
    of the clip a sample of the template, or by one in two. -inf where there is no such warp.
    """
    n, N = worth.shape
    total = np.full((n, N), -np.inf)
    begin = np.zeros((n, N), dtype=np.int64)
    total[0], begin[0] = worth[0], np.arange(N)
    for k in range(1, n):
        options = np.full((3, N), -np.inf)
        starts = np.zeros((3, N), dtype=np.int64)
        for step in (1, 2):
            options[step - 1, step:] = total[k - 1, :-step]
            starts[step - 1, step:] = begin[k - 1, :-step]
        if k > 1:
            options[2, 1:] = total[k - 2, :-1] + worth[k - 1, 1:]
            starts[2, 1:] = begin[k - 2, :-1]
        best = options.argmax(axis=0)[None]
        total[k] = worth[k] + np.take_along_axis(options, best, axis=0)[0]
        begin[k] = np.take_along_axis(starts, best, axis=0)[0]
    return total, begin


def values(total: Array, begin: Ints, rows: Ints, margin: int, least_quality: float) -> Array:
    """What each match (m, N) of templates of `rows` (m,) samples explains: the sum of its worth,
    but no more than it covers of the clip (the columns without `margin` at either end); -inf where
    its mean worth is too small."""
    N = total.shape[1]
    rows = rows[:, None]
    inside = np.clip(np.arange(N) + 1, margin, N - margin) - np.clip(begin, margin, N - margin)
    value = np.minimum(total, inside)
    good = (value > 0) & (value >= least_quality * np.minimum(rows, inside))
    return np.where(good, value, -np.inf)


def best_totals(value: Array, begin: Ints) -> Array:
    """The most that matches without overlap explain, up to each sample: (n, N + 1)."""
    n, N = value.shape
    best = np.zeros((n, N + 1))
    every = np.arange(n)
    for e in range(N):
        best[:, e + 1] = np.maximum(best[:, e], value[:, e] + best[every, begin[:, e]])
    return best


def chosen_spans(best: Array, begin: Ints) -> tuple[Span, ...]:
    """The matches of one template, `begin` (N,), behind its `best` totals (N + 1,)."""
    spans: list[Span] = []
    e = len(begin)
    while e > 0:
        if best[e] > best[e - 1]:
            spans.append((int(begin[e - 1]), e))
            e = int(begin[e - 1])
        else:
            e -= 1
    return tuple(reversed(spans))


def best_template(
    worth: Array,
    *,
    shortest: int,
    longest: int,
    stride: int,
    least_quality: float,
    cut_cost: Array,
    like_best: float,
) -> Template | None:
    """The part of the clip whose other occurrences explain most of it; None when nothing recurs.

    Tried are starts every `stride` samples of `worth` (N, N) and every length from `shortest` to
    `longest`. Of those that explain `like_best` of what the best one does, and of these by whole
    occurrences alone, the one that cuts where `cut_cost` (N,) is least on average.
    """
    N = len(worth)
    padded = np.pad(worth, ((0, 0), (longest, longest)))
    explained = np.full((N, longest + 1), -np.inf)
    for first in range(0, N - shortest + 1, stride):
        total, begin = matches(padded[first : first + longest])
        length = np.arange(1, len(total) + 1)
        value = values(total, begin, length, longest, least_quality)
        best = best_totals(value, begin)[:, -1] - length
        explained[first, length] = np.where(length >= shortest, best, -np.inf)
    ranked = np.sort(explained, axis=None)[::-1]
    if not ranked[0] > 0:
        return None
    alike = [
        _template(padded[a : a + n], least_quality, longest)
        for a, n in np.argwhere(explained >= like_best * ranked[0])
    ]
    whole = max(t.whole for t in alike)
    alike = [t for t in alike if t.whole >= like_best * whole and len(t.spans) > 1]
    if not alike:
        return None
    cost = [np.mean([cut_cost[a] + cut_cost[b - 1] for a, b in t.spans]) for t in alike]
    return alike[int(np.argmin(cost))]


def _template(rows: Array, least_quality: float, margin: int) -> Template:
    """`rows` (n, margin + N + margin)."""
    n, width = rows.shape
    total, begin = matches(rows)
    value = values(total[-1:], begin[-1:], np.array([n]), margin, least_quality)
    best = best_totals(value, begin[-1:])[0]
    spans = chosen_spans(best, begin[-1])
    N = width - 2 * margin
    inside = [(max(a - margin, 0), min(b - margin, N), b - a) for a, b in spans]
    kept = [i for i, (a, b, covered) in enumerate(inside) if b - a >= WHOLE_SHARE * covered]
    whole = sum(float(value[0, spans[i][1] - 1]) for i in kept)
    return Template(n, tuple(inside[i][:2] for i in kept), float(best[-1]) - n, whole - n)

"""Occurrences of a part of a clip in the clip itself: subsequence DTW, then interval scheduling.

The clip is followed and preceded by samples of similarity 0, so that an occurrence may run over the
clip's ends: half a repetition there is explained, but is no repetition.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

Span = tuple[int, int]  # first and one past the last sample

WHOLE_SHARE = 0.85  # an occurrence of which this much lies in the clip is not cut off


@dataclass(frozen=True)
class MatchedTemplate:
    """A part of the clip as template, and its occurrences.

    Attributes:
        samples: length of the template.
        spans: each whole occurrence, the template itself among them.
        explained: samples of the clip that the other occurrences and those cut off at the clip's
            ends cover, each times its similarity.
        whole: the same without those cut off.
    """

    samples: int
    spans: tuple[Span, ...]
    explained: float
    whole: float


def subsequence_dtw(
    similarity: Float[np.ndarray, "n N"],
) -> tuple[Float[np.ndarray, "n N"], Int[np.ndarray, "n N"]]:
    """Best match of every beginning of a template that ends at each sample of a clip.

    A warp advances by one or two samples of the clip per sample of the template, or by one in two.

    Args:
        similarity: template samples by clip samples: 1 for equal poses, 0 and less for unlike ones.

    Returns:
        The largest sum of similarity over a warp of template samples 0 to k whose last one is
        matched to e, -inf where there is no such warp; and the sample that sample 0 is matched to.
    """
    n, N = similarity.shape
    total = np.full((n, N), -np.inf)
    begin = np.zeros((n, N), dtype=np.int64)
    total[0], begin[0] = similarity[0], np.arange(N)
    for k in range(1, n):
        options = np.full((3, N), -np.inf)
        starts = np.zeros((3, N), dtype=np.int64)
        for step in (1, 2):
            options[step - 1, step:] = total[k - 1, :-step]
            starts[step - 1, step:] = begin[k - 1, :-step]
        if k > 1:
            options[2, 1:] = total[k - 2, :-1] + similarity[k - 1, 1:]
            starts[2, 1:] = begin[k - 2, :-1]
        best = options.argmax(axis=0)[None]
        total[k] = similarity[k] + np.take_along_axis(options, best, axis=0)[0]
        begin[k] = np.take_along_axis(starts, best, axis=0)[0]
    return total, begin


def match_values(
    total: Float[np.ndarray, "m N"],
    begin: Int[np.ndarray, "m N"],
    lengths: Int[np.ndarray, " m"],
    margin: int,
    least_quality: float,
) -> Float[np.ndarray, "m N"]:
    """Samples of the clip that each match explains: the sum of its similarity, at most what it
    covers of the clip; -inf where its mean similarity is too small.

    Args:
        total, begin: matches of templates, as of `subsequence_dtw`.
        lengths: of the templates, in samples.
        margin: columns at either end that lie outside the clip.
        least_quality: least mean similarity.
    """
    N = total.shape[1]
    lengths = lengths[:, None]
    inside = np.clip(np.arange(N) + 1, margin, N - margin) - np.clip(begin, margin, N - margin)
    value = np.minimum(total, inside)
    good = (value > 0) & (value >= least_quality * np.minimum(lengths, inside))
    return np.where(good, value, -np.inf)


def best_totals(
    value: Float[np.ndarray, "m N"], begin: Int[np.ndarray, "m N"]
) -> Float[np.ndarray, "m N+1"]:
    """Weighted interval scheduling: the largest total value of matches without overlap, up to each
    sample."""
    m, N = value.shape
    best = np.zeros((m, N + 1))
    every = np.arange(m)
    for e in range(N):
        best[:, e + 1] = np.maximum(best[:, e], value[:, e] + best[every, begin[:, e]])
    return best


def chosen_spans(best: Float[np.ndarray, "_"], begin: Int[np.ndarray, " N"]) -> tuple[Span, ...]:
    """The matches of one template behind its `best_totals` (N + 1,)."""
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
    similarity: Float[np.ndarray, "N N"],
    *,
    shortest: int,
    longest: int,
    stride: int,
    least_quality: float,
    cut_cost: Float[np.ndarray, " N"],
    near_best: float,
) -> MatchedTemplate | None:
    """The part of the clip whose other occurrences explain most of it; None when nothing recurs.

    Tried are starts every `stride` samples and every length from `shortest` to `longest`. Of those
    that explain `near_best` of what the best one does, and of these by whole occurrences alone, the
    one that cuts where `cut_cost` is least on average.
    """
    N = len(similarity)
    padded = np.pad(similarity, ((0, 0), (longest, longest)))
    explained = np.full((N, longest + 1), -np.inf)
    for first in range(0, N - shortest + 1, stride):
        total, begin = subsequence_dtw(padded[first : first + longest])
        length = np.arange(1, len(total) + 1)
        value = match_values(total, begin, length, longest, least_quality)
        best = best_totals(value, begin)[:, -1] - length
        explained[first, length] = np.where(length >= shortest, best, -np.inf)
    ranked = np.sort(explained, axis=None)[::-1]
    if not ranked[0] > 0:
        return None
    candidates = [
        _matched(padded[a : a + n], least_quality, longest)
        for a, n in np.argwhere(explained >= near_best * ranked[0])
    ]
    whole = max(t.whole for t in candidates)
    candidates = [t for t in candidates if t.whole >= near_best * whole and len(t.spans) > 1]
    if not candidates:
        return None
    cost = [np.mean([cut_cost[a] + cut_cost[b - 1] for a, b in t.spans]) for t in candidates]
    return candidates[int(np.argmin(cost))]


def _matched(rows: np.ndarray, least_quality: float, margin: int) -> MatchedTemplate:
    """The occurrences of the template whose similarities are `rows` (n, margin + N + margin)."""
    n, width = rows.shape
    total, begin = subsequence_dtw(rows)
    value = match_values(total[-1:], begin[-1:], np.array([n]), margin, least_quality)
    best = best_totals(value, begin[-1:])[0]
    spans = chosen_spans(best, begin[-1])
    N = width - 2 * margin
    inside = [(max(a - margin, 0), min(b - margin, N), b - a) for a, b in spans]
    whole = [i for i, (a, b, covered) in enumerate(inside) if b - a >= WHOLE_SHARE * covered]
    whole_value = sum(float(value[0, spans[i][1] - 1]) for i in whole)
    whole_spans = tuple(inside[i][:2] for i in whole)
    return MatchedTemplate(n, whole_spans, float(best[-1]) - n, whole_value - n)

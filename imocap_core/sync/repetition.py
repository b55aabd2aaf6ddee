"""Repetitions of one action in a long clip, by comparing the clip with itself.

A part of the clip is a template, and its occurrences are found by subsequence DTW and interval
scheduling. The criterion is how much of the clip its *other* occurrences explain, each pose by its
similarity. That one number decides length and number together: two repetitions as one template
explain one occurrence less, half a repetition explains half, unlike parts explain nothing. Samples
of similarity 0 before and after the clip let an occurrence run over its ends: half a repetition
there is explained, but is no repetition.

Poses are evenly spaced in motion, not in time: holds and pauses shrink, so they neither count as
repetitions nor strain the warp.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import gaussian_filter1d

from imocap_core.sync.procrustes import procrustes_distances

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


SPEED_S = 0.2  # speeds are differences over this time, longer than an estimate's jitter
SMOOTH_S = 0.1  # poses and speeds are smoothed over this time
SAMPLES_PER_S = 10.0  # of motion at its typical speed
HOLD_SHARE = 0.15  # of the typical speed: a hold passes at this rate, not at none
FASTEST_SHARE = 2.0
STILL_SHARE = 0.25  # of the typical speed: below it a repetition has ended or not begun
NEAR_BEST = 0.97  # templates that explain this share of what the best one does are as good
MAX_STARTS, _PICTURE_STARTS = 250, 50  # start positions of templates that are tried at most
_LEAST_SCORE = 0.6  # of the clip's motion one repetition must explain of the others
_LEAST_QUALITY = 0.4  # of an occurrence's poses the template must explain
# squared distance up to which a pose is explained: share of the way from its nearest pose to others
_MATCH_LEVEL = 0.4
_SHORTEST_S = 0.5  # repetition, at the clip's typical speed
_LEAST_CONFIDENCE = 0.3  # of a keypoint in the picture


@dataclass(frozen=True)
class Repetitions:
    """Repetitions of a clip.

    Attributes:
        spans: first and one past the last frame of each repetition, in order; the whole clip alone
            when nothing repeats.
        score: share of the clip's motion that one repetition explains of the rest, at most 1.
        status: one sentence.
    """

    spans: tuple[Span, ...]
    score: float
    status: str


def find_picture_repetitions(
    xy_px: Float[np.ndarray, "T K 2"], confidence: Float[np.ndarray, "T K"], fps: float
) -> Repetitions:
    """The same from 2D keypoints, which have no depth errors; the performer faces one way."""
    flat = np.pad(xy_px, ((0, 0), (0, 0), (0, 1)))
    flat[confidence < _LEAST_CONFIDENCE] = np.nan
    return find_repetitions(flat, fps, turned=False, starts=_PICTURE_STARTS)


def find_repetitions(
    poses: Float[np.ndarray, "T J 3"], fps: float, turned: bool = True, starts: int = MAX_STARTS
) -> Repetitions:
    """Cut a clip into the repetitions of its dominant action; their number is not given.

    Args:
        poses: any unit, axes and origin; NaN = missing.
        fps: frames a second.
        turned: whether poses that are turned are equal; starts: of templates, at most.
    """
    whole = ((0, len(poses)),)
    smooth = _smoothed(poses, SMOOTH_S * fps)
    speed = _speeds(smooth, fps, turned)
    typical = float(np.sqrt(np.mean(speed**2)))
    samples = _evenly_in_motion(speed / typical, fps) if typical > 0 else np.array([0])
    shortest = max(2, round(_SHORTEST_S * SAMPLES_PER_S))
    if len(samples) < 2 * shortest:
        return Repetitions(whole, 0.0, "no repetitions: the clip is too short, or nothing moves")
    template = best_template(
        _similarity(_squares(smooth[samples], turned), shortest, _MATCH_LEVEL),
        shortest=shortest,
        longest=max(shortest, round(0.6 * len(samples))),
        stride=-(-len(samples) // starts),
        least_quality=_LEAST_QUALITY,
        cut_cost=speed[samples] / typical,
        near_best=NEAR_BEST,
    )
    score = template.explained / max(len(samples) - template.samples, 1) if template else 0.0
    if template is None or score < _LEAST_SCORE or len(template.spans) < 2:
        return Repetitions(whole, score, f"no repetitions: score {score:.2f} < {_LEAST_SCORE:g}")
    motion = speed - STILL_SHARE * typical
    edges = np.append(samples, len(poses))
    spans = tuple(_trimmed(int(edges[a]), int(edges[b]), motion) for a, b in template.spans)
    lengths = np.diff(spans, axis=1) / fps
    durations = f"{lengths.min():.2f} to {lengths.max():.2f} s each"
    return Repetitions(spans, score, f"{len(spans)} repetitions, {durations}, score {score:.2f}")


def _smoothed(poses: np.ndarray, sigma: float) -> np.ndarray:
    """Poses smoothed over time (sigma in frames); a missing joint is interpolated from neighbouring
    frames, and stays NaN where none is near."""
    visible = np.isfinite(poses).all(axis=-1, keepdims=True).astype(float)
    total = gaussian_filter1d(np.where(visible > 0, poses, 0.0), sigma, axis=0, mode="nearest")
    share = gaussian_filter1d(visible, sigma, axis=0, mode="nearest")
    return np.where(share > 1e-3, total / np.maximum(share, 1e-3), np.nan)


def _speeds(poses: np.ndarray, fps: float, turned: bool) -> np.ndarray:
    """Speed (T,) of the change of pose at each frame."""
    lag = max(1, round(SPEED_S * fps))
    if len(poses) <= lag:
        return np.zeros(len(poses))
    weights = np.isfinite(poses).all(axis=-1).astype(float)
    step = np.empty(len(poses) - lag)
    for t in range(len(step)):
        now, later = (slice(i, i + 1) for i in (t, t + lag))
        step[t] = procrustes_distances(
            poses[now], poses[later], weights[now], weights[later], turned=turned
        ).item()
    middle = np.arange(len(step)) + lag / 2
    valid = np.isfinite(step)
    if not valid.any():
        return np.zeros(len(poses))
    return np.interp(np.arange(len(poses)), middle[valid], step[valid]) * fps / lag


def _evenly_in_motion(relative_speed: np.ndarray, fps: float) -> np.ndarray:
    """Frames (N,) between which the pose changes by about equal amounts, increasing."""
    pace = np.clip(relative_speed, HOLD_SHARE, FASTEST_SHARE)
    travelled = np.concatenate([[0.0], np.cumsum(0.5 * (pace[1:] + pace[:-1]))]) / fps
    marks = np.arange(0.0, travelled[-1], 1.0 / SAMPLES_PER_S)
    return np.unique(np.searchsorted(travelled, marks))


def _squares(poses: np.ndarray, turned: bool) -> np.ndarray:
    """Squared distances of all pairs (N, N); unknown ones count as the mean."""
    weights = np.isfinite(poses).all(axis=-1).astype(float)
    square = procrustes_distances(poses, poses, weights, weights, turned=turned) ** 2
    return np.where(np.isfinite(square), square, np.nanmean(square))


def _similarity(squares: np.ndarray, apart: int, match_level: float) -> np.ndarray:
    """1 for pairs as close as a pose's nearest one elsewhere (at least `apart` samples away), 0 at
    the match level, never below -1."""
    N = len(squares)
    elsewhere = np.abs(np.arange(N)[:, None] - np.arange(N)) >= apart
    near = float(np.median(np.where(elsewhere, squares, np.inf).min(axis=1)))
    reach = match_level * max(float(squares[elsewhere].mean()) - near, 0.0) + 1e-12
    return np.clip(1.0 - (squares - near) / reach, -1.0, 1.0)


def _trimmed(first: int, stop: int, motion: np.ndarray) -> Span:
    """The part of a span with the most motion: the largest sum of `motion` (T,), which is negative
    where the performer is nearly still. Short movements within a pause at its ends are trimmed with
    it."""
    total = np.concatenate([[0.0], np.cumsum(motion[first:stop])])
    lowest = np.minimum.accumulate(total)
    end = int(np.argmax(total - lowest))
    begin = int(np.argmin(total[: end + 1]))
    return (first + begin, first + end) if end > begin else (first, stop)

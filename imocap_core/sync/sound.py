"""Offsets between recordings of one event, by the onsets in their sound.

An onset is loud at the same moment for every microphone, however each one filters and amplifies:
what is compared is by how much each band of frequencies grows, on its own scale. The offset is
where the two envelopes correlate most; music that repeats correlates elsewhere, too, and then the
offset is not sure.

`scipy.signal` is loaded where it is used: that takes a sixth of the time that the stages take to
load, and few actions have sound.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np
from jaxtyping import Float
from scipy.ndimage import uniform_filter1d

RATE_HZ = 16_000.0  # of the samples
STEP_S, WINDOW_S = 0.01, 0.032  # of an envelope
BANDS, LOWEST_HZ, HIGHEST_HZ = 20, 100.0, 7000.0
MEAN_S = 1.0  # over which the mean is taken from an envelope
LEAST_OVERLAP_S = 1.0
NEAR_S = 0.15  # correlations that are nearer to the largest belong to it
SURE_RATIO = 1.7  # of the largest correlation to the next
SURE_SCORE = 7.0  # of the largest correlation, in standard deviations of all
COMMON_SCORE = 9.0  # that other events do not reach
CONSISTENT_S = 0.03  # by how much three sure offsets may miss each other


@dataclass(frozen=True)
class PairOffset:
    """Recording b began `offset_s` after recording a; ratio: of the best fit to the next best one;
    score: of the best fit, in standard deviations."""

    offset_s: float
    other_s: float
    ratio: float
    score: float

    @property
    def common(self) -> bool:
        """Whether the two have any sound in common."""
        return self.score >= COMMON_SCORE

    @property
    def sure(self) -> bool:
        """Whether the offset is the only one that fits."""
        return self.score >= SURE_SCORE and self.ratio >= SURE_RATIO


def onset_envelope(samples: Float[np.ndarray, " N"]) -> Float[np.ndarray, " T"]:
    """Growth of the spectrum's bands at every step of `STEP_S`, mean zero.

    Args:
        samples: at `RATE_HZ`.
    """
    from scipy.signal import stft

    window, step = round(WINDOW_S * RATE_HZ), round(STEP_S * RATE_HZ)
    if len(samples) < window:
        return np.zeros(0)
    frequencies, _, spectrum = stft(
        samples, RATE_HZ, nperseg=window, noverlap=window - step, nfft=2 * window
    )
    power = np.abs(spectrum) ** 2
    edges = np.geomspace(LOWEST_HZ, HIGHEST_HZ, BANDS + 1)
    rows = [power[(frequencies >= a) & (frequencies < b)] for a, b in pairwise(edges)]
    bands = np.stack([row.sum(axis=0) for row in rows if len(row)])
    floor = 1e-2 * bands.mean(axis=1, keepdims=True) + 1e-20
    growth = np.maximum(
        np.diff(np.log(bands + floor), axis=1, prepend=np.log(bands[:, :1] + floor)), 0.0
    )
    envelope = growth.mean(axis=0)
    envelope = np.log1p(envelope / (envelope.std() + 1e-12))  # so that no single clap decides
    return np.asarray(envelope - uniform_filter1d(envelope, round(MEAN_S / STEP_S), mode="nearest"))


def pair_offset(a: Float[np.ndarray, " T"], b: Float[np.ndarray, " U"]) -> PairOffset | None:
    """The offset of two envelopes; None where they are silent or too short to overlap.

    The correlation over the overlap is multiplied by the root of its length: without a common sound
    it has one and the same spread at every offset.
    """
    from scipy.signal import correlate

    least = round(LEAST_OVERLAP_S / STEP_S)
    if min(len(a), len(b)) < least or not a.any() or not b.any():
        return None
    products = correlate(a, b, mode="full", method="fft")
    energy_a = correlate(a**2, np.ones(len(b)), mode="full", method="fft")
    energy_b = correlate(np.ones(len(a)), b**2, mode="full", method="fft")
    lags = np.arange(len(products)) - (len(b) - 1)  # a[t + lag] with b[t]
    overlap = np.minimum(len(a), lags + len(b)) - np.maximum(lags, 0)
    usable = overlap >= least
    scale = np.sqrt(np.maximum(energy_a * energy_b, 1e-12 * energy_a.max() * energy_b.max()))
    score = np.where(usable, products / scale * np.sqrt(overlap), -np.inf)
    best = int(score.argmax())
    far = np.abs(lags - lags[best]) * STEP_S > NEAR_S
    rest = np.where(far & usable, score, -np.inf)
    other = int(rest.argmax())
    spread = (
        float(np.sqrt(np.median(score[far & usable] ** 2) / 0.4549))
        if (far & usable).any()
        else 1.0
    )
    second = max(float(rest[other]), spread) if np.isfinite(rest[other]) else spread
    return PairOffset(
        (lags[best] + _peak(score, best)) * STEP_S,
        float(lags[other] * STEP_S),
        float(score[best]) / second,
        float(score[best]) / spread,
    )


def _peak(values: Float[np.ndarray, " L"], best: int) -> float:
    """Where the parabola through the largest value and its neighbours is largest."""
    if not 0 < best < len(values) - 1 or not np.isfinite(values[best - 1 : best + 2]).all():
        return 0.0
    before, middle, after = values[best - 1 : best + 2]
    bend = before - 2 * middle + after
    return float(0.5 * (before - after) / bend) if bend < 0 else 0.0


def pair_offsets(
    envelopes: Sequence[Float[np.ndarray, " _"] | None],
) -> dict[tuple[int, int], PairOffset]:
    """The offsets of all pairs of recordings that have a sound."""
    pairs = {}
    for a, b in combinations(range(len(envelopes)), 2):
        first, second = envelopes[a], envelopes[b]
        offset = None if first is None or second is None else pair_offset(first, second)
        if offset is not None:
            pairs[a, b] = offset
    return pairs


def consistent_offsets(
    pairs: Mapping[tuple[int, int], PairOffset], count: int
) -> Float[np.ndarray, " M"]:
    """When each recording began, seconds after the first one of the largest group that sure offsets
    tie together; NaN outside it.

    Least squares over the sure pairs; as long as a pair misses the others' agreement, the pair that
    misses it most is left out.
    """
    sure = {pair: offset for pair, offset in pairs.items() if offset.sure}
    while True:
        group = _largest_group(list(sure), count)
        start = np.full(count, np.nan)
        if len(group) < 2:
            return start
        inside = {pair: x for pair, x in sure.items() if pair[0] in group}
        rows = np.zeros((len(inside) + 1, len(group)))
        for row, (a, b) in zip(rows, inside, strict=False):
            row[group.index(a)], row[group.index(b)] = -1.0, 1.0
        rows[-1, 0] = 1.0
        measured = np.array([*(x.offset_s for x in inside.values()), 0.0])
        start[group] = np.linalg.lstsq(rows, measured, rcond=None)[0]
        misses = {(a, b): abs(start[b] - start[a] - x.offset_s) for (a, b), x in inside.items()}
        worst = max(misses, key=lambda pair: misses[pair])
        if misses[worst] <= CONSISTENT_S:
            return start
        del sure[worst]


def _largest_group(pairs: Sequence[tuple[int, int]], count: int) -> list[int]:
    """The largest set of recordings that pairs connect, in order."""
    group = list(range(count))
    for a, b in pairs:
        first, second = sorted((group[a], group[b]))
        group = [first if g == second else g for g in group]
    members = [[v for v in range(count) if group[v] == g] for g in dict.fromkeys(group)]
    return max(members, key=len)

"""Processor time of two ways to do the same work, measured in turn, at two sizes."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

MOST_TIMES = 5  # repetitions of each; the shortest counts


@dataclass(frozen=True)
class Entrants:
    """One size of a contest: the amount of work that the growth is by, and both ways to do it."""

    amount: int
    ours: Callable[[], object]
    rival: Callable[[], object]


@dataclass(frozen=True)
class RatioRow:
    """A part of the program and its rival at one size.

    ours_ms, rival_ms: processor time. ratio: rival's over ours; at_least: the rival was stopped at
    this multiple. growth: exponents of both times by the amount since the size before, NaN for
    the first.
    """

    part: str
    rival: str
    size: str
    ours_ms: float
    rival_ms: float
    ratio: float
    at_least: bool = False
    growth: float = math.nan
    rival_growth: float = math.nan


def contest(
    part: str, rival: str, unit: str, sizes: Sequence[Entrants], seconds: float
) -> list[RatioRow]:
    """A row a size, the smaller first; up to `seconds` for each, at least one call of both."""
    rows = []
    for entrants in sizes:
        ours, theirs = _in_turn(entrants, seconds)
        rows.append(
            RatioRow(part, rival, f"{entrants.amount:,} {unit}", ours, theirs, theirs / ours)
        )
    return with_growth(rows, [entrants.amount for entrants in sizes])


def with_growth(rows: Sequence[RatioRow], amounts: Sequence[int]) -> list[RatioRow]:
    """The rows of one contest with their exponents. amounts: of work, ascending."""
    out = list(rows[:1])
    for k in range(1, len(rows)):
        before, row, more = rows[k - 1], rows[k], math.log(amounts[k] / amounts[k - 1])
        growth = math.log(row.ours_ms / before.ours_ms) / more
        rival_growth = math.log(row.rival_ms / before.rival_ms) / more
        out.append(replace(row, growth=growth, rival_growth=rival_growth))
    return out


def _in_turn(entrants: Entrants, seconds: float) -> tuple[float, float]:
    """Shortest processor times of both, ms; ours is called once before, to load what it needs."""
    entrants.ours()
    best = [math.inf, math.inf]
    began = time.perf_counter()
    for repeat in range(MOST_TIMES):
        if repeat and time.perf_counter() - began > seconds:
            break
        for k, work in enumerate((entrants.ours, entrants.rival)):
            start = time.process_time()
            work()
            best[k] = min(best[k], max(time.process_time() - start, 1e-6))
    return 1e3 * best[0], 1e3 * best[1]

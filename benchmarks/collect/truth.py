"""What a compilation shows, and how a list of what was collected from it compares."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

from benchmarks.collect.edit import CutPiece
from imocap_core.collect.listing import CollectedList, ListedOccurrence, ListedShot

NEAR = 2  # frames: a boundary is found if one is reported within so many of it
Boundary = tuple[int, int, str]  # first and one past the last frame of no shot, kind


@dataclass(frozen=True)
class Tally:
    """Counts of what is there, what of it was found, and what was found but is not there."""

    there: int
    found_right: int
    wrong: int

    @property
    def recall(self) -> float:
        """Share of what is there."""
        return self.found_right / self.there if self.there else float("nan")

    @property
    def precision(self) -> float:
        """Share of what was found that is right."""
        every = self.found_right + self.wrong
        return self.found_right / every if every else float("nan")


def true_boundaries(places: Sequence[CutPiece]) -> list[Boundary]:
    """Boundaries between the shots of a film; blank pieces are boundaries, not shots."""
    shots = [place for place in places if place.piece.file is not None]
    edges: list[Boundary] = [] if shots[0].first == 0 else [(0, shots[0].first, "black")]
    for a, b in pairwise(shots):
        between = [p for p in places if a.stop <= p.first and p.stop <= b.first and p not in (a, b)]
        edges.append((a.stop, b.first, "black" if between else b.piece.into))
    return edges


def boundary_tally(shots: Sequence[ListedShot], truth: Sequence[Boundary]) -> Tally:
    """How many of a film's boundaries were found."""
    reported = [(a.frames[1], b.frames[0]) for a, b in pairwise(shots)]
    if shots and shots[0].frames[0] > 0:
        reported.insert(0, (0, shots[0].frames[0]))
    unused = list(reported)
    right = 0
    for first, stop, _ in truth:
        near = [r for r in unused if r[0] <= stop + NEAR and r[1] >= first - NEAR]
        if near:
            unused.remove(near[0])
            right += 1
    return Tally(len(truth), right, len(unused))


def shown_by(occurrence: ListedOccurrence, places: Sequence[CutPiece]) -> CutPiece | None:
    """The piece that an occurrence is mostly of."""

    def shared(place: CutPiece) -> int:
        return min(place.stop, occurrence.frames[1]) - max(place.first, occurrence.frames[0])

    best = max(places, key=shared)
    return best if shared(best) > 0 else None


def action_of(place: CutPiece | None) -> str | None:
    """The action that a piece shows; None for none, and for a still picture."""
    if place is None or place.piece.shown is None or place.piece.still:
        return None
    return place.piece.shown.partition("/")[0]


def occurrence_tally(
    collected: CollectedList, films: Mapping[int, Sequence[CutPiece]], action: str
) -> Tally:
    """How many of the shots that show an action were found, and how many occurrences are others."""
    pieces = {(film, k) for film, places in films.items() for k, p in enumerate(places)
              if action_of(p) == action}  # fmt: skip
    hit: set[tuple[int, int]] = set()
    wrong = 0
    for occurrence in collected.occurrences:
        place = shown_by(occurrence, films[occurrence.film])
        if place is not None and action_of(place) == action:
            hit.add((occurrence.film, list(films[occurrence.film]).index(place)))
        else:
            wrong += 1
    return Tally(len(pieces), len(hit), wrong)


def replay_tally(collected: CollectedList, films: Mapping[int, Sequence[CutPiece]]) -> Tally:
    """How many pairs of occurrences that show one take are linked, and how many others are."""
    takes = {
        o.id: place.piece.shown if (place := shown_by(o, films[o.film])) is not None else None
        for o in collected.occurrences
    }
    shots = {o.id: (o.film, o.shot) for o in collected.occurrences}
    group = {o.id: o.same_take or o.id for o in collected.occurrences}
    there = right = wrong = 0
    for a, b in combinations(takes, 2):
        if shots[a] == shots[b]:
            continue
        same, linked = takes[a] is not None and takes[a] == takes[b], group[a] == group[b]
        there += same
        right += same and linked
        wrong += linked and not same
    return Tally(there, right, wrong)


def mirror_tally(
    collected: CollectedList, films: Mapping[int, Sequence[CutPiece]], action: str
) -> Tally:
    """How many of the mirrored occurrences of an action are marked, and how many others are."""
    there = right = wrong = 0
    for occurrence in collected.occurrences:
        place = shown_by(occurrence, films[occurrence.film])
        if place is None or action_of(place) != action:
            continue
        there += place.piece.mirrored
        right += place.piece.mirrored and occurrence.mirrored
        wrong += occurrence.mirrored and not place.piece.mirrored
    return Tally(there, right, wrong)

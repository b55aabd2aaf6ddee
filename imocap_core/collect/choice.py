"""Which occurrences become videos: none twice, then the best of every view."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from imocap_core.collect.occurrences import Occurrence, view_difference_deg
from imocap_core.params import CollectParams

LEAST_S = 0.4  # a shorter one has too little motion


@dataclass(frozen=True)
class SameTakeAs:
    """An occurrence shows the take of another one, `rate` times as fast."""

    other: int
    rate: float


@dataclass(frozen=True)
class Decision:
    """Whether an occurrence becomes a video, and if not, why. same_take: of which it is a showing
    again."""

    chosen: bool
    reason: str = ""
    same_take: SameTakeAs | None = None


def decide(
    occurrences: Sequence[Occurrence],
    showings: Mapping[int, SameTakeAs],
    names: Sequence[str],
    fps: Sequence[float],
    params: CollectParams,
) -> list[Decision]:
    """A decision on every occurrence.

    Args:
        showings: occurrences that show a take again, by index, and the showing that stays.
        names: of the occurrences, for the reasons. fps: of their films.
    """
    decisions: dict[int, Decision] = {}
    usable = []
    for i, occurrence in enumerate(occurrences):
        fault = _fault(occurrence, fps[i], params)
        if i in showings:
            decisions[i] = Decision(False, _showing(showings[i], names), showings[i])
        elif fault:
            decisions[i] = Decision(False, fault)
        else:
            usable.append(i)
    ranked = _by_view(occurrences, usable, params.view_deg)
    for place, i in enumerate(ranked):
        reason = "" if place < params.keep else _less(occurrences, ranked, i, names, params)
        decisions[i] = Decision(place < params.keep, reason)
    return [decisions[i] for i in range(len(occurrences))]


def _fault(occurrence: Occurrence, fps: float, params: CollectParams) -> str:
    if occurrence.height_px < params.least_height_px:
        return f"too small: {occurrence.height_px:.0f} px"
    if (occurrence.stop - occurrence.first) / fps < LEAST_S:
        return f"too short: {(occurrence.stop - occurrence.first) / fps:.1f} s"
    if occurrence.visible < params.least_visible:
        return f"the person is detected in {occurrence.visible:.0%} of it only"
    return ""


def _showing(same: SameTakeAs, names: Sequence[str]) -> str:
    if 0.85 < same.rate < 1.18:
        return f"duplicate of {names[same.other]}"
    return f"replay of {names[same.other]} at {same.rate:.2g} times its speed"


def _by_view(
    occurrences: Sequence[Occurrence], usable: Sequence[int], view_deg: float
) -> list[int]:
    """The usable ones in the order in which they are taken: the best one of each view, then the
    second best of each, and so on."""
    placed: list[tuple[int, float, int]] = []
    for i in sorted(usable, key=lambda k: -occurrences[k].quality):
        near = [
            k
            for _, _, k in placed
            if view_difference_deg(occurrences[i], occurrences[k]) < view_deg
        ]
        placed.append((len(near), -occurrences[i].quality, i))
    return [i for _, _, i in sorted(placed)]


def _less(
    occurrences: Sequence[Occurrence],
    ranked: Sequence[int],
    i: int,
    names: Sequence[str],
    params: CollectParams,
) -> str:
    near = [
        names[k]
        for k in ranked[: params.keep]
        if view_difference_deg(occurrences[i], occurrences[k]) < params.view_deg
    ]
    if near:
        return f"less visible than others of that view ({', '.join(near)})"
    return f"more than {params.keep} occurrences (collect.keep)"

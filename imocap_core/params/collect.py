"""Parameters of what `imocap collect` takes from long films."""

from __future__ import annotations

from dataclasses import dataclass

from imocap_core.params.bounds import Count, NonNegative, Positive, Share, param


@dataclass(frozen=True, kw_only=True)
class CollectParams:
    """Occurrences of an action in long films (`imocap collect`; collect.md)."""

    match_level: Positive = param(
        0.6,
        "Squared distance of two poses up to which they count as alike, as a share of the median "
        "one between the template and all poses of the films.",
    )
    least_score: Share = param(
        0.4, "Mean likeness of an occurrence to the template; below it nothing is one."
    )
    certain_score: Share = param(
        0.62, "Mean likeness from which on a stretch is an occurrence, whatever else is like it."
    )
    least_contrast: NonNegative = param(
        1.0,
        "Between these two: by how many robust standard deviations of all people's best scores "
        "an occurrence must exceed their median.",
    )
    recurring_score: Share = param(
        0.6, "Without an example: mean likeness from which on a stretch counts as a repetition."
    )
    slowest: Share = param(0.2, "Slowest playback of an occurrence, times the template's speed.")
    fastest: Positive = param(2.5, "Fastest playback of an occurrence, times the template's speed.")
    shortest_s: Positive = param(
        1.0, "Without an example: shortest movement that is looked for.", unit="s"
    )
    longest_s: Positive = param(
        3.0, "Without an example: longest movement that is looked for.", unit="s"
    )
    margin_s: NonNegative = param(
        0.15, "What is taken of a shot before and after an occurrence.", unit="s"
    )
    least_height_px: Positive = param(
        60.0, "People whose box has a smaller diagonal are too small to be captured.", unit="px"
    )
    least_visible: Share = param(
        0.8, "Share of an occurrence's frames in which the person must be detected."
    )
    mirror_margin: Share = param(
        0.3,
        "An occurrence is taken as mirrored where the mirrored template's score is larger by so "
        "much.",
    )
    view_deg: Positive = param(
        30.0, "Occurrences from directions that differ by less show the same view.", unit="deg"
    )
    keep: Count = param(8, "Most occurrences that become videos of the action.")

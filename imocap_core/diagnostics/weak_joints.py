"""Ill-determined joints, and what to film next."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from imocap_core.artifacts.schemas import SyncSummary, Uncertainty, Viewpoint, WeakSpan
from imocap_core.diagnostics.findings import Finding, frames_text

SHOWN = 3  # of a video


def weak_findings(claimed: Uncertainty) -> list[Finding]:
    """One finding per video with ill-determined spans, the worst spans first."""
    by_video: dict[str, list[WeakSpan]] = {}
    for span in claimed.weak:
        by_video.setdefault(span.video, []).append(span)
    return [_of_video(video, spans) for video, spans in by_video.items()]


def least_certain(claimed: Uncertainty) -> str:
    """The worst span of all as a clause; empty when no joint stands out."""
    if not claimed.weak:
        return ""
    return f"least certain is {claimed.weak[0].video}'s {_span(claimed.weak[0])}"


def _of_video(video: str, spans: list[WeakSpan]) -> Finding:
    more = len(spans) - SHOWN
    end = f", and {more} more in observability.md" if more > 0 else ""
    text = "least certain: " + ", ".join(_span(span) for span in spans[:SHOWN]) + end
    return Finding("joints", video, text, f"{spans[0].joint.replace('_', ' ')} uncertain")


def _span(span: WeakSpan) -> str:
    joint = span.joint.replace("_", " ")
    where = frames_text(span.first_frame, span.last_frame)
    return f"{joint} in {where} (expected error {span.sigma_mm:.0f} mm)"


MIN_BENEFIT_RATIO = 1.5  # of the best side for one more camera to the worst, to name a side
NEAR_DEG = 50.0  # a side this close to a video that is there is not missing
SIDES = (
    *("in front", "front left", "left", "back left"),
    *("behind", "back right", "right", "front right"),
)  # every 45 degrees


def further_view(claimed: Uncertainty, sync: SyncSummary) -> str:
    """A clause on the most useful further camera; empty where none can be named.

    Sides on which a video stands that was left out or mirrored are not suggested: that video may
    show them.
    """
    treated = doubted_azimuths(claimed, sync)
    if treated is None:
        return ""
    possible = [v for v in claimed.viewpoints if not _taken(v, treated)]
    if not possible:
        return ""
    best = max(possible, key=lambda v: v.reduction)
    least = min(v.reduction for v in claimed.viewpoints)
    if best.reduction < MIN_BENEFIT_RATIO * least:
        if treated:
            return ""
        low, high = f"{_error_reduction(least):.0%}", f"{_error_reduction(best.reduction):.0%}"
        about = low if low == high else f"{low} to {high}"
        return f"one more video from any side would make the expected errors about {about} smaller"
    return (
        f"one more video would help most {place_of(claimed, best.azimuth_deg)}: expected errors "
        f"about {_error_reduction(best.reduction):.0%} smaller"
    )


def place_of(claimed: Uncertainty, azimuth_deg: float) -> str:
    """Where a camera at this azimuth stands."""
    plain = {"in front": "the front", "behind": "behind"}
    if claimed.azimuth_from == "performer":
        side = side_of(azimuth_deg)
        beside = f"the performer's {side}"
        return f"from {plain.get(side, beside)}"
    # who faces a camera has the left hand on the picture's right
    in_picture = side_of(-azimuth_deg)
    return f"from {plain.get(in_picture, f'the {in_picture}')} as the reference camera sees it"


def side_of(azimuth_deg: float) -> str:
    """Name of a camera's side, from the performer's point of view."""
    return SIDES[round(azimuth_deg / 45) % len(SIDES)]


def doubted_azimuths(claimed: Uncertainty, sync: SyncSummary) -> list[float] | None:
    """Where the videos that were left out or mirrored may stand; None when that is unknown.

    The azimuth of a video that was left out comes of its monocular motion, which may be reversed or
    reflected in depth: all four possibilities count.
    """
    azimuths: list[float] = []
    for video in claimed.videos:
        a = video.azimuth_deg
        if video.id in sync.excluded:
            if not np.isfinite(a):
                return None
            azimuths += [a, a + 180, -a, 180 - a]
        elif video.id in sync.mirrored:
            azimuths += [a, -a]
    return azimuths


def _taken(viewpoint: Viewpoint, azimuths: Sequence[float]) -> bool:
    apart_deg = (abs((viewpoint.azimuth_deg - a + 180) % 360 - 180) for a in azimuths)
    return any(apart < NEAR_DEG for apart in apart_deg)


def _error_reduction(variance_share: float) -> float:
    """Share by which standard deviations fall when variances fall by a share."""
    return float(1 - np.sqrt(max(0.0, 1 - variance_share)))

"""Ill-determined joints, by their claimed standard deviations."""

from __future__ import annotations

from imocap_core.artifacts.schemas import Uncertainty, WeakSpan
from imocap_core.verdict.findings import Finding, frames_text

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

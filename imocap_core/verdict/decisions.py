"""What the program decided about whole videos, and how to overrule it."""

from __future__ import annotations

import numpy as np

from imocap_core.artifacts.schemas import SyncSummary
from imocap_core.verdict.findings import Finding

KEEP = "`--set sync.outliers=report` (in action.yaml `params: {sync: {outliers: report}}`)"


def decision_findings(sync: SyncSummary) -> list[Finding]:
    """Videos that were left out or mirrored, and what else was noticed about whole videos."""
    findings = [_excluded(sync, video) for video in sync.excluded]
    findings += [_mirrored(sync, video) for video in sync.mirrored if video not in sync.excluded]
    treated = {*sync.excluded, *sync.mirrored}
    for note in sync.notes:
        video = next((i for i in sync.ids if note.startswith(f"{i} ")), "")
        if video in treated:
            continue
        text = note.removeprefix(f"{video} ") if video else note
        findings.append(Finding("remark", video, text, text))
    return findings


def _excluded(sync: SyncSummary, video: str) -> Finding:
    return Finding(
        "decision",
        video,
        f"left out, because it seems to show another action{_score(sync, video)}; its motion is "
        "that of this video alone and not in the others' time",
        "left out as another action",
        f"if it does show this action, run again with {KEEP}",
    )


def _mirrored(sync: SyncSummary, video: str) -> Finding:
    if any(note.startswith(f"{video} is declared mirrored") for note in sync.notes):
        return Finding("remark", video, "mirrored, as action.yaml declares", "mirrored as declared")
    return Finding(
        "decision",
        video,
        f"treated as its mirror image{_margin(sync, video)}",
        "treated as mirrored",
        f"if its picture is not flipped, write `mirrored: false` below `id: {video}` in "
        "action.yaml, and `mirrored: true` if it is",
    )


def _score(sync: SyncSummary, video: str) -> str:
    value = _trust(sync, video, "outlier_score")
    return f" (score {value:.2f}; usual videos stay below 0.9)" if np.isfinite(value) else ""


def _margin(sync: SyncSummary, video: str) -> str:
    value = _trust(sync, video, "mirror_margin")
    if not np.isfinite(value):
        return ""
    return f", because it fits the others {100 * (np.exp(value) - 1):.0f} % better so"


def _trust(sync: SyncSummary, video: str, name: str) -> float:
    videos = [] if sync.trust is None else sync.trust.videos
    return next((float(getattr(v, name)) for v in videos if v.id == video), float("nan"))

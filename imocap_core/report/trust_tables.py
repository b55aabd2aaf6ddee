"""How far the synchronisation can be trusted, as tables of the report; no truth is needed."""

from __future__ import annotations

import math

from imocap_core.artifacts.schemas import SyncSummary, Table

Cell = str | bool | int | float | None


def trust_tables(sync: SyncSummary) -> list[Table]:
    """A row a video, a row a triple of videos; none for a synchronisation that has no trust."""
    if sync.trust is None or len(sync.ids) < 2:
        return []
    videos: list[list[Cell]] = [
        [
            v.id + (" (reference)" if v.id == sync.reference else ""),
            _treated(sync, v.id),
            _known(v.outlier_score),
            _known(v.mirror_margin),
            _known(v.left_out_frames),
            _known(v.left_out_s),
            _known(v.left_out_share),
        ]
        for v in sync.trust.videos
    ]
    triples: list[list[Cell]] = [
        [" ".join(t.videos), _known(t.frames), _known(t.seconds), t.share]
        for t in sync.trust.triples
    ]
    columns = ["video", "treated", "outlier_score", "mirror_margin"]
    columns += ["left_out_frames", "left_out_s", "left_out_share"]
    made = [
        Table(
            name="trust",
            title="Trust, by video (no truth needed)",
            columns=columns,
            rows=videos,
            note=" ".join(f"{note}." for note in sync.notes)
            or "No video stands out as another action or as mirrored.",
        )
    ]
    if triples:
        made.append(
            Table(
                name="cycles",
                title="Going round three videos, by the maps found pair by pair",
                columns=["videos", "residual_frames", "residual_s", "share"],
                rows=triples,
            )
        )
    return made


def _treated(sync: SyncSummary, video: str) -> str:
    if video in sync.excluded:
        return "excluded"
    return "mirrored" if video in sync.mirrored else ""


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None

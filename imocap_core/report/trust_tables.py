"""Plausibility of the synchronisation, without truth, as tables of the report."""

from __future__ import annotations

import math

from imocap_core.artifacts.schemas import SyncSummary, SyncTrust, Table
from imocap_core.artifacts.schemas.evaluate import Cell


def trust_tables(sync: SyncSummary) -> list[Table]:
    """One row per video and per triple of videos; no table when `sync.trust` is missing."""
    if sync.trust is None or len(sync.ids) < 2:
        return []
    videos: list[list[Cell]] = [
        [
            v.id + (" (reference)" if v.id == sync.reference else ""),
            _treated(sync, v.id),
            _finite(v.outlier_score),
            _finite(v.mirror_margin),
            _finite(v.left_out_frames),
            _finite(v.left_out_s),
            _finite(v.left_out_share),
            _finite(v.repetition_s),
            _finite(v.repetition_ratio),
        ]
        for v in sync.trust.videos
    ]
    triples: list[list[Cell]] = [
        [" ".join(t.videos), _finite(t.frames), _finite(t.seconds), t.share]
        for t in sync.trust.triples
    ]
    columns = ["video", "treated", "outlier_score", "mirror_margin"]
    columns += ["left_out_frames", "left_out_s", "left_out_share"]
    columns += ["repetition_s", "repetition_ratio"]
    tables = [
        Table(
            name="trust",
            title="Trust in the synchronisation, by video (needs no truth)",
            columns=columns,
            rows=videos,
            note=" ".join(f"{note}." for note in sync.notes) or _nothing_noticed(sync.trust),
        )
    ]
    if triples:
        tables.append(
            Table(
                name="cycles",
                title="Round trips over three videos, by the pairwise maps",
                columns=["videos", "residual_frames", "residual_s", "share"],
                rows=triples,
            )
        )
    return tables


def _nothing_noticed(trust: SyncTrust) -> str:
    """A sentence where there are no notes."""
    if any(math.isfinite(v.outlier_score) for v in trust.videos):
        return "No video stands out as another action or as mirrored."
    return (
        "With two videos it cannot be decided which of them shows another action, so none is left "
        "out; neither seems mirrored."
    )


def _treated(sync: SyncSummary, video: str) -> str:
    if video in sync.excluded:
        return "excluded"
    return "mirrored" if video in sync.mirrored else ""


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None

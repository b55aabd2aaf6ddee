"""How far results can be trusted: standard deviations, observability, synchronisation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from imocap_core.artifacts.schemas import (
    NearPair,
    SyncSummary,
    SyncTrust,
    Table,
    Uncertainty,
    VideoMotion,
    WeakSpan,
)
from imocap_core.artifacts.schemas.motion_schemas import Cell
from imocap_core.conventions import EVAL_12, EVAL_INDICES, SMPL_JOINTS
from imocap_core.diagnostics.findings import listed
from imocap_core.diagnostics.weak_joints import further_view
from imocap_core.evaluate.action_scores import (
    CALIBRATION_METRICS,
    NORMALISED_CAMERA_ERROR,
    joint_errors_mm,
)
from imocap_core.io.truth import Truth
from imocap_core.metrics.calibration import normalised_errors
from imocap_core.metrics.scoring import ALL_VIDEOS, ScoreRow
from imocap_core.report.table_files import Row, table_of


def uncertainty_tables(
    claimed: Uncertainty,
    motions: Sequence[VideoMotion],
    truth: Truth | None,
    rows: Sequence[ScoreRow],
) -> list[Table]:
    """Tables with one row per video, per joint, and per further viewpoint."""
    tables = [_by_video(claimed, rows), _by_joint(claimed, motions, truth)]
    if claimed.viewpoints:
        views = [(v.azimuth_deg, v.reduction) for v in claimed.viewpoints]
        rows_of = [{"azimuth_deg": a, "reduction_share": reduction} for a, reduction in views]
        tables.append(table_of("viewpoints", rows_of))
    return tables


def leave_one_out_tables(claimed: Uncertainty) -> list[Table]:
    """How well each video is predicted without it; no table of a single video."""
    rows: list[Row] = [
        {
            "video": v.id,
            "error_pct_height": _finite(100 * v.error_share),
            "share_10": _finite(v.near_share),
            "monocular_error_pct_height": _finite(100 * v.monocular_error_share),
            "frames": v.frames,
        }
        for v in claimed.leave_one_out
    ]
    return [table_of("leave_one_out", rows)] if rows else []


def _by_video(claimed: Uncertainty, rows: Sequence[ScoreRow]) -> Table:
    value = {(r.video, r.metric): r.value for r in rows}
    sds = ("sigma_mm", "depth_mm", "across_mm")

    def row(video: str, azimuth: float | None, sigma: Row, rotation: float | None) -> Row:
        metrics = {metric: value.get((video, metric)) for metric in CALIBRATION_METRICS}
        last = {NORMALISED_CAMERA_ERROR: value.get((video, NORMALISED_CAMERA_ERROR))}
        first: Row = {"video": video, "azimuth_deg": azimuth}
        return first | sigma | metrics | {"camera_rotation_deg": rotation} | last

    by_video = [
        row(
            v.id,
            _finite(v.azimuth_deg),
            {name: _rms(getattr(v, name)[:, EVAL_INDICES]) for name in sds},
            _finite(v.camera_rotation_deg),
        )
        for v in claimed.videos
    ]
    means: Row = {name: _mean([of[name] for of in by_video]) for name in sds}
    return table_of("uncertainty", [*by_video, row(ALL_VIDEOS, None, means, None)], claimed.status)


def _by_joint(claimed: Uncertainty, motions: Sequence[VideoMotion], truth: Truth | None) -> Table:
    """All 24 joints where the truth of every video has them, else the twelve."""
    all_known = all(joint_errors_mm(m, truth, SMPL_JOINTS) is not None for m in motions)
    joints = SMPL_JOINTS if all_known else EVAL_12
    index = [SMPL_JOINTS.index(name) for name in joints]
    sigma, error = [], []
    for video, motion in zip(claimed.videos, motions, strict=True):
        errors = joint_errors_mm(motion, truth, joints)
        sigma.append(video.sigma_mm[:, index])
        vectors = errors if errors is not None else np.full((*sigma[-1].shape, 3), np.nan)
        error.append(np.linalg.norm(vectors, axis=-1))
    claims, true = np.concatenate(sigma), np.concatenate(error)
    ratio = normalised_errors(true, claims)
    rows: list[Row] = [
        {
            "joint": name,
            "sigma_mm": _rms(claims[:, j]),
            "error_mm": _rms(true[:, j]),
            "normalised_error": _finite(ratio[j]),
        }
        for j, name in enumerate(joints)
    ]
    return table_of("uncertainty_joints", rows)


def _rms(x: Float[np.ndarray, "..."]) -> float | None:
    finite = x[np.isfinite(x)]
    return float(np.sqrt(np.mean(finite**2))) if len(finite) else None


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _mean(cells: Sequence[Cell]) -> float | None:
    numbers = [cell for cell in cells if isinstance(cell, float)]
    return float(np.mean(numbers)) if numbers else None


FILE = "observability.md"
SHOWN = 8  # spans listed on the report's page; observability.md lists all


def sentences(claimed: Uncertainty, sync: SyncSummary, most: int | None = SHOWN) -> list[str]:
    """Near-identical viewpoints, the most useful further viewpoint, and ill-determined spans.

    most: maximum number of spans, None for all.
    """
    lines = [_near(pair) for pair in claimed.near]
    lines += _further(claimed, sync)
    weak = claimed.weak if most is None else claimed.weak[:most]
    lines += [_weak(span) for span in weak]
    if len(weak) < len(claimed.weak):
        lines.append(f"observability.md lists {len(claimed.weak) - len(weak)} more spans.")
    if not claimed.weak:
        twice = f"twice the action's median of {claimed.median_mm:.0f} mm"
        lines.append(f"No joint's standard deviation stays above {twice}.")
    return lines


def observability_table(claimed: Uncertainty, sync: SyncSummary) -> Table:
    """The sentences as a table of the report."""
    return table_of("open", [{"sentence": sentence} for sentence in sentences(claimed, sync)])


def write_observability(folder: Path, title: str, claimed: Uncertainty, sync: SyncSummary) -> str:
    """Write the whole observability report into a folder; returns its file name."""
    lines = "\n".join(f"* {sentence}" for sentence in sentences(claimed, sync, most=None))
    text = f"# {title}: observability\n\n{claimed.status}\n\n{lines}\n"
    (folder / FILE).write_text(text, encoding="utf-8")
    return FILE


def _near(pair: NearPair) -> str:
    a, b = pair.videos
    depth = "the other videos" if pair.seen_across else "priors"
    return (
        f"{a} and {b} show the performer from nearly the same side ({pair.angle_deg:.0f} degrees "
        f"apart): depth along their line of sight depends on {depth}."
    )


def _further(claimed: Uncertainty, sync: SyncSummary) -> list[str]:
    """The most useful further viewpoint, or why none is named."""
    clause = further_view(claimed, sync)
    if clause:
        return [f"{clause[0].upper()}{clause[1:]}."]
    treated = [i for i in sync.ids if i in {*sync.excluded, *sync.mirrored}]
    if not treated or not claimed.viewpoints:
        return []
    return [
        f"No side is suggested for one more camera: {listed(treated)} may show what is missing "
        "(left out, or treated as mirrored)."
    ]


def _weak(span: WeakSpan) -> str:
    joint = span.joint.replace("_", " ")
    return (
        f"{span.video}: {joint} from {span.begin_s:.1f} to {span.end_s:.1f} s (frames "
        f"{span.first_frame} to {span.last_frame}): {span.sigma_mm:.0f} mm, {span.of_median:.1f} "
        "times the action's median."
    )


def trust_tables(sync: SyncSummary) -> list[Table]:
    """One row per video and per triple of videos; no table when `sync.trust` is missing."""
    if sync.trust is None or len(sync.ids) < 2:
        return []
    numbers = [
        *("outlier_score", "mirror_margin", "left_out_frames", "left_out_s", "left_out_share"),
        *("repetition_s", "repetition_ratio"),
    ]
    treated = dict.fromkeys(sync.mirrored, "mirrored") | dict.fromkeys(sync.excluded, "excluded")
    videos: list[Row] = [
        {
            "video": v.id + (" (reference)" if v.id == sync.reference else ""),
            "treated": treated.get(v.id, ""),
            **{name: _finite(getattr(v, name)) for name in numbers},
        }
        for v in sync.trust.videos
    ]
    triples: list[Row] = [
        {
            "videos": " ".join(t.videos),
            "residual_frames": _finite(t.frames),
            "residual_s": _finite(t.seconds),
            "share": t.share,
        }
        for t in sync.trust.triples
    ]
    note = " ".join(f"{note}." for note in sync.notes) or _nothing_noticed(sync.trust)
    tables = [table_of("trust", videos, note)]
    return [*tables, table_of("cycles", triples)] if triples else tables


def _nothing_noticed(trust: SyncTrust) -> str:
    """A sentence where there are no notes."""
    if any(math.isfinite(v.outlier_score) for v in trust.videos):
        return "No video stands out as another action or as mirrored."
    return (
        "With two videos it cannot be decided which of them shows another action, so none is left "
        "out; neither seems mirrored."
    )

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


def uncertainty_tables(
    claimed: Uncertainty,
    motions: Sequence[VideoMotion],
    truth: Truth | None,
    rows: Sequence[ScoreRow],
) -> list[Table]:
    """Tables with one row per video, per joint, and per further viewpoint."""
    tables = [_by_video(claimed, rows), _by_joint(claimed, motions, truth)]
    if claimed.viewpoints:
        cells: list[list[Cell]] = [[v.azimuth_deg, v.reduction] for v in claimed.viewpoints]
        tables.append(
            Table(
                name="viewpoints",
                title="One more camera: reduction of the common motion's variance",
                columns=["azimuth_deg", "reduction_share"],
                rows=cells,
            )
        )
    return tables


def leave_one_out_tables(claimed: Uncertainty) -> list[Table]:
    """How well each video is predicted without it; no table of a single video."""
    if not claimed.leave_one_out:
        return []
    cells: list[list[Cell]] = [
        [
            v.id,
            _finite(100 * v.error_share),
            _finite(v.near_share),
            _finite(100 * v.monocular_error_share),
            v.frames,
        ]
        for v in claimed.leave_one_out
    ]
    return [
        Table(
            name="leave_one_out",
            title="Each video predicted by the others (needs no truth)",
            columns=[
                "video",
                "error_pct_height",
                "share_10",
                "monocular_error_pct_height",
                "frames",
            ],
            rows=cells,
        )
    ]


def _by_video(claimed: Uncertainty, rows: Sequence[ScoreRow]) -> Table:
    value = {(r.video, r.metric): r.value for r in rows}
    cells: list[list[Cell]] = [
        [
            v.id,
            v.azimuth_deg if np.isfinite(v.azimuth_deg) else None,
            *(_rms(x[:, EVAL_INDICES]) for x in (v.sigma_mm, v.depth_mm, v.across_mm)),
            *(value.get((v.id, metric)) for metric in CALIBRATION_METRICS),
            _finite(v.camera_rotation_deg),
            value.get((v.id, NORMALISED_CAMERA_ERROR)),
        ]
        for v in claimed.videos
    ]
    means = [value.get((ALL_VIDEOS, metric)) for metric in CALIBRATION_METRICS]
    means += [None, value.get((ALL_VIDEOS, NORMALISED_CAMERA_ERROR))]
    cells.append([ALL_VIDEOS, None, *(_mean(cells, k) for k in (2, 3, 4)), *means])
    return Table(
        name="uncertainty",
        title="Claimed standard deviations (root mean square over 12 joints) and normalised errors",
        columns=[
            *("video", "azimuth_deg", "sigma_mm", "depth_mm", "across_mm", *CALIBRATION_METRICS),
            *("camera_rotation_deg", NORMALISED_CAMERA_ERROR),
        ],
        rows=cells,
        note=claimed.status,
    )


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
    rows: list[list[Cell]] = [
        [name, _rms(claims[:, j]), _rms(true[:, j]), _finite(ratio[j])]
        for j, name in enumerate(joints)
    ]
    return Table(
        name="uncertainty_joints",
        title="Claimed standard deviation and error (root mean squares), by joint",
        columns=["joint", "sigma_mm", "error_mm", "normalised_error"],
        rows=rows,
    )


def _rms(x: Float[np.ndarray, "..."]) -> float | None:
    finite = x[np.isfinite(x)]
    return float(np.sqrt(np.mean(finite**2))) if len(finite) else None


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _mean(cells: Sequence[Sequence[Cell]], column: int) -> float | None:
    numbers = [cell for row in cells if isinstance(cell := row[column], float)]
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
        lines.append(
            f"No joint's standard deviation stays above {claimed.weak_limit:g} times the action's "
            f"median of {claimed.median_mm:.0f} mm."
        )
    return lines


def observability_table(claimed: Uncertainty, sync: SyncSummary) -> Table:
    """The sentences as a table of the report."""
    return Table(
        name="open",
        title="Observability",
        columns=["sentence"],
        rows=[[sentence] for sentence in sentences(claimed, sync)],
    )


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
    videos: list[list[Cell]] = [
        [
            v.id + (" (reference)" if v.id == sync.reference else ""),
            "excluded" if v.id in sync.excluded else "mirrored" if v.id in sync.mirrored else "",
            *map(_finite, (v.outlier_score, v.mirror_margin, v.left_out_frames, v.left_out_s)),
            *map(_finite, (v.left_out_share, v.repetition_s, v.repetition_ratio)),
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

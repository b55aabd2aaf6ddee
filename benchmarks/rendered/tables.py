"""The tables of `imocap benchmark rendered`: errors of the motion, and of the detector."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from benchmarks.detector.detection_errors import (
    DetectedClip,
    PointErrors,
    point_errors,
    swapped_share,
)
from benchmarks.scoring.score_file import RESULTS, ActionScore
from benchmarks.tables import (
    ALL_JOINTS,
    CAMERA,
    DETAILS,
    PA,
    SCALED,
    SYNC,
    cell,
    cost_sentence,
    gap_closed,
    markdown_table,
    mean_cell,
    missing_sentence,
)
from imocap_core.detect.detectors import detector_of
from imocap_core.params import DetectParams

BODY = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
SIDES = ("front", "side", "back")
Value = Callable[[ActionScore], float | None]


def markdown(
    scores: Sequence[ActionScore],
    films: Sequence[DetectedClip],
    names: Sequence[str],
    missing: Sequence[str],
    command: str,
) -> str:
    """The whole report."""
    errors = point_errors(films, names)
    parts = [
        "# From pixels: captured performances rendered, detected by a real detector",
        f"Made by `{command}`: performances of `trials` on the free body, each in its own scene "
        f"and before its own camera, detected by {detector_name()}. "
        f"{cost_sentence([s.costs for s in scores])} `estimator` is the detector's 3D alone."
        + missing_sentence(missing),
        motion_table(scores),
        DETAILS,
        "## The detector's errors",
        f"{len(films)} films, {sum(len(f.true_px) for f in films)} frames. Lengths are hundredths "
        "of the person's standing height in the picture (1.7 cm on a person of 1.7 m). `spread`: "
        "per axis, about the mean of the film, without outliers. `lasts`: share and time constant "
        "of what persists. An outlier is further than 5 spreads from the middle of its point; "
        "hidden limbs are guessed, with a confidence that mostly is too low to be used.",
        points_table(errors),
        sides_table(films, names),
        "## What the simulated detector would need",
        proposal(films, errors, names),
    ]
    return "\n\n".join(parts) + "\n"


def detector_name() -> str:
    """The detector of `keypoints: detect` that nobody chose another for, with its version."""
    return detector_of(DetectParams(), Path()).version


def motion_table(scores: Sequence[ActionScore]) -> str:
    """One row for each action, and their mean."""
    columns: list[tuple[str, int, Value]] = [
        *((result, 1, _of(result, SCALED)) for result in RESULTS),
        ("gap closed %", 0, _gap),
        ("P-MPJPE, after loop", 1, _of("after loop", PA)),
        ("24 joints, not scaled, after loop", 1, _of("after loop", ALL_JOINTS)),
        ("sync %", 2, _of("after loop", SYNC)),
        ("cameras °", 1, _of("after loop", CAMERA)),
    ]
    rows = [
        [s.action, str(s.videos), str(s.frames), *(cell(of(s), n) for _, n, of in columns)]
        for s in scores
    ]
    means = [
        mean_cell([value for s in scores if (value := of(s)) is not None], digits)
        for _, digits, of in columns
    ]
    rows.append(["**mean**", "", "", *means])
    return "MPJPE, scaled, mm on 12 joints, unless the column says otherwise.\n\n" + markdown_table(
        ["action", "videos", "frames", *(name for name, _, _ in columns)], rows
    )


def points_table(errors: Sequence[PointErrors]) -> str:
    """One row for each point."""
    rows = [
        [
            p.point,
            f"{100 * p.bias_x:+.2f}, {100 * p.bias_y:+.2f}",
            f"{100 * p.spread:.2f}",
            f"{cell(p.persistent, 2)}, {cell(p.persistence_s, 2)} s",
            f"{100 * p.outlier_rate:.1f}",
            f"{100 * p.outlier_size:.1f}",
            f"{100 * p.unused_rate:.1f}",
            f"{100 * p.used_outlier_rate:.1f}",
            f"{100 * p.miss_rate:.1f}",
        ]
        for p in errors
    ]
    head = ["point", "bias x, y", "spread", "lasts", "outliers %", "their size"]
    head += ["not used %", "outliers of those used %", "missed %"]
    return markdown_table(head, rows)


def sides_table(films: Sequence[DetectedClip], names: Sequence[str]) -> str:
    """One row for each side of view: all body points together."""
    body = _body(names)
    rows = []
    for side in SIDES:
        of_side = [film for film in films if film.side == side]
        if not of_side:
            continue
        errors = np.concatenate(
            [np.linalg.norm(f.error[:, body], axis=-1).ravel() for f in of_side]
        )
        errors = errors[np.isfinite(errors)]
        swapped = [_mean([swapped_share(f, names, p) for f in of_side]) for p in ("arm", "leg")]
        rows.append(
            [
                side,
                str(len(of_side)),
                *(f"{100 * np.quantile(errors, q):.2f}" for q in (0.5, 0.9)),
                *(cell(100 * share, 1) for share in swapped),
            ]
        )
    head = ["seen from", "films", "median error", "90 % below", "arms swapped %"]
    return markdown_table([*head, "legs swapped %"], rows)


def proposal(
    films: Sequence[DetectedClip], errors: Sequence[PointErrors], names: Sequence[str]
) -> str:
    """Parameters of imocap_core/synthetic/detector.py that agree with the measured errors."""
    body = [errors[k] for k in _body(names)]
    swaps = [swapped_share(film, names, part) for film in films for part in ("arm", "leg")]
    values = [
        ("noise", float(np.sqrt(_mean([p.spread**2 for p in body]))), 4),
        ("persistent share (0.5 in the code)", _median([p.persistent for p in body]), 2),
        ("persistence_s", _median([p.persistence_s for p in body]), 2),
        ("outlier_rate", _mean([p.outlier_rate for p in body]), 3),
        ("outlier_noise", _median([p.outlier_size for p in body if p.outlier_size > 0]), 3),
        ("miss_rate", _mean([p.miss_rate for p in body]), 3),
        ("swap_rate", _mean(swaps), 3),
        ("bias (root mean square; not modelled)", _bias(body), 4),
    ]
    rows = [[name, cell(value, digits)] for name, value, digits in values]
    return (
        "Over shoulders, elbows, wrists, hips, knees and ankles; a proposal, not in force.\n\n"
        + markdown_table(["DetectorErrors", "measured"], rows)
    )


def _of(result: str, metric: str) -> Value:
    return lambda score: score.of(result, metric)


def _gap(score: ActionScore) -> float | None:
    gap = gap_closed(*(score.of(r, SCALED) for r in ("monocular", "after loop", "oracle")))
    return gap if np.isfinite(gap) else None


def _body(names: Sequence[str]) -> list[int]:
    return [k for k, name in enumerate(names) if name.split("_", 1)[-1] in BODY]


def _mean(values: Sequence[float]) -> float:
    finite = [value for value in values if np.isfinite(value)]
    return float(np.mean(finite)) if finite else float("nan")


def _median(values: Sequence[float]) -> float:
    finite = [value for value in values if np.isfinite(value)]
    return float(np.median(finite)) if finite else float("nan")


def _bias(body: Sequence[PointErrors]) -> float:
    return float(np.sqrt(_mean([(p.bias_x**2 + p.bias_y**2) / 2 for p in body])))

"""Before the videos are synchronised: which are mirrored, and which show another action?"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imocap_core.sync.levels import (
    alignment_gains,
    expected_squares,
    matched_levels,
    squares_between,
    thinned,
    typical_square,
)
from imocap_core.sync.mirror import find_mirrored, mirror_evidence, mirrored_poses
from imocap_core.sync.outliers import find_outliers, follow_the_order, may_be_outliers

Array = NDArray[np.float64]

OUTLIERS = ("exclude", "report", "ignore")
MIRRORED = ("flip", "report", "ignore")


@dataclass(frozen=True)
class Screening:
    """What was found about the videos, and what is done about it (indices of videos).

    outlier_score, mirror_margin (M,): see `outliers` and `mirror`; NaN where not looked at.
    """

    outliers: tuple[int, ...]  # found
    mirrored: tuple[int, ...]  # found or declared
    excluded: tuple[int, ...]  # taken out of the joint work
    flipped: tuple[int, ...]  # treated as their mirror image
    outlier_score: Array
    mirror_margin: Array


def nothing_found(count: int, flipped: Sequence[int] = ()) -> Screening:
    """The screening of videos that nobody looked at."""
    unknown = np.full(count, np.nan)
    return Screening((), tuple(flipped), (), tuple(flipped), unknown, unknown.copy())


def screen(
    poses: Sequence[Array],
    weights: Sequence[Array],
    fps: Sequence[float],
    *,
    outliers: str,
    mirrored: str,
    twins: Sequence[int] | None,
    declared: Sequence[bool | None],
    max_rate: float,
    kept: Sequence[bool] | None = None,
) -> Screening:
    """Look for mirrored videos, then, with those reflected, for videos of another action.

    `poses` (T_v, J, 3) of one body scale, `weights` (T_v, J), `fps`; `twins` (J,): each joint's
    mirror twin, None when not known (then no video is called mirrored); `declared`: True or False
    where the user has said whether a video is mirrored; `kept` (M,): videos that are no outliers,
    whatever they look like. Raises ValueError for unknown switches.
    """
    _check(outliers, mirrored)
    M = len(poses)
    told = [v for v in range(M) if declared[v]]
    if told and twins is None:
        raise ValueError(
            "mirrored: a video is declared mirrored, but the joints' twins are unknown"
        )
    look_mirrored = twins is not None and mirrored != "ignore"
    if M < 2 or (outliers == "ignore" and not look_mirrored):
        return nothing_found(M, told)
    thin, w, rates = thinned(poses, weights, fps)
    reflected = [x if twins is None else mirrored_poses(x, twins) for x in thin]
    seen_in_mirror = w if twins is None else [v[:, list(twins)] for v in w]
    for v in told:
        thin[v], reflected[v] = reflected[v], thin[v]
        w[v], seen_in_mirror[v] = seen_in_mirror[v], w[v]
    squares = squares_between(thin, w, thin, w)
    near = typical_square(squares)
    fits = expected_squares(squares, rates, near, max_rate)
    levels = matched_levels(fits, M)
    found: list[int] = []
    margins = np.full(M, np.nan)
    if look_mirrored:
        other = squares_between(thin, w, reflected, seen_in_mirror)
        turned = expected_squares(other, rates, near, max_rate)
        # compared frame for frame, so that what only one video shows weighs alike on both sides
        whole = [matched_levels(f, M, share=1.0) for f in (fits, turned)]
        evidence = mirror_evidence(whole[0], whole[1])
        found, margins = find_mirrored(evidence, [d is not None for d in declared])
        signs = np.ones(M)
        signs[found] = -1
        levels = np.where(np.outer(signs, signs) > 0, levels, matched_levels(turned, M))
        squares = {(i, j): (squares if signs[i] == signs[j] else other)[i, j] for i, j in squares}
    strangers: list[int] = []
    scores = np.full(M, np.nan)
    if outliers != "ignore":
        stay = np.zeros(M, dtype=bool) if kept is None else np.asarray(kept)
        if may_be_outliers(levels):
            stay = stay | follow_the_order(alignment_gains(squares, rates, near, max_rate, M))
        strangers, scores = find_outliers(levels, stay)
        found = [v for v in found if v not in strangers]  # another action has no mirror image here
    flips = found if mirrored == "flip" else []
    return Screening(
        outliers=tuple(sorted(strangers)),
        mirrored=tuple(sorted({*found, *told})),
        excluded=tuple(sorted(strangers)) if outliers == "exclude" else (),
        flipped=tuple(sorted({*flips, *told})),
        outlier_score=scores,
        mirror_margin=margins,
    )


def sentences(found: Screening, names: Sequence[str]) -> list[str]:
    """What was found and done, for people; `names` of the videos."""
    said = []
    for v in found.outliers:
        done = (
            "kept out of the joint work, its frames unmatched (sync.outliers: exclude)"
            if v in found.excluded
            else "used all the same (sync.outliers: report)"
        )
        said.append(
            f"{names[v]} seems to show another action: its poses stay further from the other "
            f"videos than those from each other (score {found.outlier_score[v]:.2f}, 1 is usual): "
            f"{done}"
        )
    for v in found.mirrored:
        margin = found.mirror_margin[v]
        why = (
            f"fits the others {100 * (np.exp(margin) - 1):.0f} % better reflected"
            if np.isfinite(margin) and margin > 0
            else "is declared mirrored"
        )
        done = "treated as its mirror image" if v in found.flipped else "left as it is"
        said.append(f"{names[v]} {why}: {done}")
    left = len(names) - len(found.excluded)
    if found.excluded and left == 2:
        said.append(
            "only two videos are left, and of two nobody can say which shows another action; "
            "check the excluded ones, or set sync.outliers: report"
        )
    return said


def _check(outliers: str, mirrored: str) -> None:
    faults = []
    if outliers not in OUTLIERS:
        faults.append(f"outliers: expected one of {', '.join(OUTLIERS)}, got {outliers!r}")
    if mirrored not in MIRRORED:
        faults.append(f"mirrored: expected one of {', '.join(MIRRORED)}, got {mirrored!r}")
    if faults:
        raise ValueError("; ".join(faults))

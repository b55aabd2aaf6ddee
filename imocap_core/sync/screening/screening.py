"""Before the videos are synchronised: which are mirrored, and which show another action?"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imocap_core.sync.screening.evidence import Seen, mirrored_among, outliers_among
from imocap_core.sync.screening.mirror import CLEAR_MARGIN, mirrored_poses
from imocap_core.sync.screening.outliers import LARGEST_SCORE
from imocap_core.sync.screening.warp_residual import thinned

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
    order = list(range(poses[0].shape[1])) if twins is None else list(twins)
    straight = Seen(thin, w)
    turned = Seen([mirrored_poses(x, order) for x in thin], [v[:, order] for v in w])
    straight, turned = straight.swapped(told, turned)
    found: list[int] = []
    margins = np.full(M, np.nan)
    if look_mirrored:
        pinned = [d is not None for d in declared]
        found, margins = mirrored_among(straight, turned, rates, max_rate, pinned)
    strangers: list[int] = []
    scores = np.full(M, np.nan)
    if outliers != "ignore":
        stay = np.zeros(M, dtype=bool) if kept is None else np.asarray(kept)
        alike, _ = straight.swapped(found, turned)
        strangers, scores = outliers_among(alike, rates, max_rate, stay)
        found = [v for v in found if v not in strangers]  # another action has no mirror image here
    flips = [v for v in found if margins[v] > CLEAR_MARGIN] if mirrored == "flip" else []
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
            f"{names[v]} seems to show another action: it stays further from the other videos than "
            f"they from each other, and their order of time explains little of it (score "
            f"{found.outlier_score[v]:.2f}, above {LARGEST_SCORE} is another action): {done}"
        )
    for v in found.mirrored:
        margin = found.mirror_margin[v]
        why = (
            f"fits the others {100 * (np.exp(margin) - 1):.0f} % better reflected"
            if np.isfinite(margin) and margin > 0
            else "is declared mirrored"
        )
        done = (
            "treated as its mirror image"
            if v in found.flipped
            else "left as it is (mirrored: true in action.yaml flips it)"
        )
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

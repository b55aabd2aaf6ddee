"""Screening before the synchronisation: mirrored videos, and videos of another action."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.params import SyncParams
from imocap_core.sync.screening.evidence import WeightedPoses
from imocap_core.sync.screening.explanation import prepared
from imocap_core.sync.screening.keypoint_decisions import decide_by_keypoints
from imocap_core.sync.screening.mirror import mirrored_poses
from imocap_core.sync.screening.pose_decisions import decide_by_poses
from imocap_core.sync.screening.registration import Keypoints2D
from imocap_core.sync.screening.warp_residual import thinned

OUTLIERS = ("exclude", "report", "ignore")
MIRRORED = ("flip", "report", "ignore")


@dataclass(frozen=True)
class Screening:
    """Mirrored videos, videos of another action, and what is done about them (video indices).

    Attributes:
        outliers: detected.
        mirrored: detected or declared.
        excluded: left out of the joint synchronisation and reconstruction.
        flipped: treated as their mirror image.
        outlier_score, mirror_margin: see `outliers` and `mirror`; NaN where not computed.
        undecided: look like another action, but it is not clear; they take part.
        symmetric: the action is nearly its own mirror image: no video can be called mirrored.
    """

    outliers: tuple[int, ...]
    mirrored: tuple[int, ...]
    excluded: tuple[int, ...]
    flipped: tuple[int, ...]
    outlier_score: Float[np.ndarray, " M"]
    mirror_margin: Float[np.ndarray, " M"]
    undecided: tuple[int, ...] = ()
    symmetric: bool = False


def not_screened(count: int, flipped: Sequence[int] = ()) -> Screening:
    """The screening of videos that were not examined."""
    unknown = np.full(count, np.nan)
    return Screening((), tuple(flipped), (), tuple(flipped), unknown, unknown.copy())


def screen(
    poses: Sequence[Float[np.ndarray, "_T J 3"]],
    weights: Sequence[Float[np.ndarray, "_T J"]],
    fps: Sequence[float],
    params: SyncParams,
    *,
    twins: Sequence[int] | None,
    declared: Sequence[bool | None],
    never_outliers: Sequence[bool] | None = None,
    keypoints: Sequence[Keypoints2D] | None = None,
) -> Screening:
    """Detect mirrored videos, then, with those reflected, videos of another action.

    Args:
        poses: of one body scale.
        weights: of the joints.
        twins: each joint's mirror twin; None when not given (then no video is called mirrored).
        declared: True or False where the user states whether a video is mirrored.
        never_outliers: videos that are no outliers, whatever their score.
        keypoints: of the poses' joints in the same frames. With keypoints and twins the keypoints
            decide, held against the others' common motion (`keypoint_decisions`), because poses
            may come of a monocular fit that went wrong; else the poses do (`pose_decisions`).

    Raises:
        ValueError: unknown switches, or a video declared mirrored without twins.
    """
    _check(params)
    look_outliers = params.outliers != "ignore"
    look_mirrored = twins is not None and params.mirrored != "ignore"
    M = len(poses)
    declared_mirrored = [v for v in range(M) if declared[v]]
    if declared_mirrored and twins is None:
        raise ValueError(
            "mirrored: a video is declared mirrored, but the joints' twins are unknown"
        )
    if M < 2 or not (look_outliers or look_mirrored):
        return not_screened(M, declared_mirrored)
    pinned = [d is not None for d in declared]
    never = np.zeros(M, dtype=bool) if never_outliers is None else np.asarray(never_outliers)
    thin, w, rates = thinned(poses, weights, fps)
    if keypoints is not None and twins is not None:
        films = _thinned_keypoints(keypoints, fps)
        videos, paired = prepared(thin, films, twins)
        upright = [v.mirrored(paired) if d else v for v, d in zip(videos, declared, strict=True)]
        decided = decide_by_keypoints(
            upright, paired, pinned, never,
            look_mirrored=look_mirrored, look_outliers=look_outliers,
        )  # fmt: skip
    else:
        order = list(range(poses[0].shape[1])) if twins is None else list(twins)
        plain = WeightedPoses(thin, w)
        mirror = WeightedPoses([mirrored_poses(x, order) for x in thin], [v[:, order] for v in w])
        decided = decide_by_poses(
            *plain.swapped(declared_mirrored, mirror), rates, params.max_rate, pinned, never,
            look_mirrored=look_mirrored, look_outliers=look_outliers,
        )  # fmt: skip
    flips = decided.clearly_mirrored if params.mirrored == "flip" else ()
    outliers = tuple(sorted(decided.outliers))
    return Screening(
        outliers=outliers,
        mirrored=tuple(sorted({*decided.mirrored, *declared_mirrored})),
        excluded=outliers if params.outliers == "exclude" else (),
        flipped=tuple(sorted({*flips, *declared_mirrored})),
        outlier_score=decided.score,
        mirror_margin=decided.margin,
        undecided=decided.undecided,
        symmetric=decided.symmetric,
    )


def _thinned_keypoints(keypoints: Sequence[Keypoints2D], fps: Sequence[float]) -> list[Keypoints2D]:
    """Keypoints at the frames of `thinned`."""
    points, weights, _ = thinned([k.xy_px for k in keypoints], [k.weight for k in keypoints], fps)
    return [Keypoints2D(*both) for both in zip(points, weights, strict=True)]


def _check(params: SyncParams) -> None:
    outliers, mirrored, faults = params.outliers, params.mirrored, []
    if outliers not in OUTLIERS:
        faults.append(f"outliers: expected one of {', '.join(OUTLIERS)}, got {outliers!r}")
    if mirrored not in MIRRORED:
        faults.append(f"mirrored: expected one of {', '.join(MIRRORED)}, got {mirrored!r}")
    if faults:
        raise ValueError("; ".join(faults))

"""Screening before the synchronisation: mirrored videos, and videos of another action."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from imocap_core.params import SyncParams
from imocap_core.sync.screening.evidence import WeightedPoses, mirrored_among, outliers_among
from imocap_core.sync.screening.mirror import CLEAR_MARGIN, mirrored_poses
from imocap_core.sync.screening.mirrored_keypoints import judged_by_keypoints, reflected_keypoints
from imocap_core.sync.screening.registration import Keypoints2D, explained_by_others
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
        explained: unlike the others by their poses, but their keypoints are explained by the
            others' motion (`registration`): no outliers.
        refuted: mirrored by their poses, but not by their keypoints (`mirrored_keypoints`).
    """

    outliers: tuple[int, ...]
    mirrored: tuple[int, ...]
    excluded: tuple[int, ...]
    flipped: tuple[int, ...]
    outlier_score: Float[np.ndarray, " M"]
    mirror_margin: Float[np.ndarray, " M"]
    explained: tuple[int, ...] = ()
    refuted: tuple[int, ...] = ()


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
        keypoints: of the poses' joints in the same frames: a video whose keypoints the others'
            motion explains is no outlier, and one whose keypoints it explains as they are is not
            mirrored, because its poses may come of a monocular fit that went wrong.

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
    thin, w, rates = thinned(poses, weights, fps)
    order = list(range(poses[0].shape[1])) if twins is None else list(twins)
    plain = WeightedPoses(thin, w)
    reflected = WeightedPoses([mirrored_poses(x, order) for x in thin], [v[:, order] for v in w])
    plain, reflected = plain.swapped(declared_mirrored, reflected)
    films = None
    if keypoints is not None:
        films = _thinned_keypoints(keypoints, fps, declared_mirrored, order)
    thinned_videos = ThinnedVideos(plain, reflected, rates, films, order)
    detected: list[int] = []
    refuted: list[int] = []
    margins = np.full(M, np.nan)
    if look_mirrored:
        pinned = [d is not None for d in declared]
        detected, refuted, margins = _mirrored(thinned_videos, params.max_rate, pinned)
    other_action: list[int] = []
    explained: list[int] = []
    scores = np.full(M, np.nan)
    if look_outliers:
        never = np.zeros(M, dtype=bool) if never_outliers is None else np.asarray(never_outliers)
        other_action, explained, scores = _other_actions(
            thinned_videos, params.max_rate, detected, never
        )
        # another action has no mirror image here
        detected = [v for v in detected if v not in other_action]
    flips = [v for v in detected if margins[v] > CLEAR_MARGIN] if params.mirrored == "flip" else []
    return Screening(
        outliers=tuple(sorted(other_action)),
        mirrored=tuple(sorted({*detected, *declared_mirrored})),
        excluded=tuple(sorted(other_action)) if params.outliers == "exclude" else (),
        flipped=tuple(sorted({*flips, *declared_mirrored})),
        outlier_score=scores,
        mirror_margin=margins,
        explained=tuple(sorted(explained)),
        refuted=tuple(sorted(refuted)),
    )


@dataclass(frozen=True)
class ThinnedVideos:
    """What is screened: poses as they are and reflected, their rates, and keypoints if known.

    twins: each joint's mirror twin.
    """

    plain: WeightedPoses
    reflected: WeightedPoses
    rates: Sequence[float]
    films: Sequence[Keypoints2D] | None
    twins: Sequence[int]


def _mirrored(
    videos: ThinnedVideos, max_rate: float, pinned: Sequence[bool]
) -> tuple[list[int], list[int], Float[np.ndarray, " M"]]:
    """Mirrored videos, those that only look so by their poses, and the margins."""
    detected, margins = mirrored_among(
        videos.plain, videos.reflected, videos.rates, max_rate, pinned
    )
    if videos.films is None:
        return detected, [], margins
    return judged_by_keypoints(
        detected, margins, pinned, videos.plain.poses, videos.films, videos.twins
    )


def _other_actions(
    videos: ThinnedVideos, max_rate: float, mirrored: Sequence[int], never: Bool[np.ndarray, " M"]
) -> tuple[list[int], list[int], Float[np.ndarray, " M"]]:
    """Videos of another action, those that only look so by their poses, and the scores."""
    upright, _ = videos.plain.swapped(mirrored, videos.reflected)
    suspects, scores = outliers_among(upright, videos.rates, max_rate, never)
    if videos.films is None:
        return suspects, [], scores
    films = [
        reflected_keypoints(film, videos.twins) if v in mirrored else film
        for v, film in enumerate(videos.films)
    ]
    explained = _explained(suspects, upright.poses, films)
    return [v for v in suspects if v not in explained], explained, scores


def _explained(
    suspects: Sequence[int],
    motions: Sequence[Float[np.ndarray, "_T J 3"]],
    keypoints: Sequence[Keypoints2D],
) -> list[int]:
    """Suspects whose keypoints the motion of the others, suspects apart, explains."""
    others = [v for v in range(len(motions)) if v not in suspects]
    if len(others) < 2:
        return []
    return [v for v in suspects if explained_by_others(v, others, motions, keypoints)]


def _thinned_keypoints(
    keypoints: Sequence[Keypoints2D],
    fps: Sequence[float],
    reflected: Sequence[int],
    twins: Sequence[int],
) -> list[Keypoints2D]:
    """Keypoints at the frames of `thinned`, those of some videos seen in a mirror."""
    points, weights, _ = thinned([k.xy_px for k in keypoints], [k.weight for k in keypoints], fps)
    films = []
    for v, (xy_px, weight) in enumerate(zip(points, weights, strict=True)):
        film = Keypoints2D(xy_px, weight)
        films.append(reflected_keypoints(film, twins) if v in reflected else film)
    return films


def _check(params: SyncParams) -> None:
    outliers, mirrored, faults = params.outliers, params.mirrored, []
    if outliers not in OUTLIERS:
        faults.append(f"outliers: expected one of {', '.join(OUTLIERS)}, got {outliers!r}")
    if mirrored not in MIRRORED:
        faults.append(f"mirrored: expected one of {', '.join(MIRRORED)}, got {mirrored!r}")
    if faults:
        raise ValueError("; ".join(faults))

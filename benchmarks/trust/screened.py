"""Detection of videos that show another action, and of mirrored ones.

Each action of trials is screened three times: as it is, with one video replaced by another
action's, and with one video mirrored. The screening sees the pipeline's monocular fits; the true
poses are screened likewise, which shows the cases that cannot be decided at all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from benchmarks.actions.captured import video_rng
from imocap_core.params import SyncParams
from imocap_core.sync.comparable_poses import body_scales
from imocap_core.sync.screening.mirror import mirrored_poses
from imocap_core.sync.screening.screening import Screening, screen

PURPOSE = 11  # of the random numbers: which video, and by which action it is replaced


@dataclass(frozen=True)
class PoseVideos:
    """The videos of an action: poses and fps of each, and the mirror twin of each joint (J)."""

    poses: list[Float[np.ndarray, "T J 3"]]
    fps: list[float]
    twins: tuple[int, ...]


@dataclass(frozen=True)
class TrustRow:
    """One action: the video that was replaced or mirrored, and the videos detected in each case."""

    action: str
    clean: str  # detected as outliers or mirrored in the unchanged videos
    clean_flipped: str
    replaced: str  # the video, and the action of its replacement
    found_outliers: str
    mirrored: str
    found_mirrored: str
    flipped: str
    outlier_score: float  # of the replaced video
    clean_score: float  # the largest of the unchanged videos
    mirror_margin: float  # of the mirrored video
    clean_margin: float


def measure(actions: Mapping[str, PoseVideos], max_rate: float) -> list[TrustRow]:
    """One row for each action, in the order of names; `max_rate` as `sync.max_rate`."""
    names = sorted(actions)
    return [_row(name, names, actions, max_rate) for name in names]


def totals(rows: Sequence[TrustRow], of: str) -> list[str]:
    """Counts of detections and of false alarms, one sentence each; `of`: the kind of poses."""
    n = len(rows)
    counts = {
        "the video of another action detected, and no other": sum(map(outlier_found, rows)),
        "the mirrored video detected, and no other": sum(map(mirrored_found, rows)),
        "the mirrored video flipped, and no other": sum(r.flipped == r.mirrored for r in rows),
        "something detected where nothing is wrong": sum(r.clean != "-" for r in rows),
        "a video flipped that is not mirrored": sum(r.clean_flipped != "-" for r in rows),
    }
    return [f"{of}: {what}: {count} of {n}" for what, count in counts.items()]


def among_decidable(rows: Sequence[TrustRow], true: Sequence[TrustRow]) -> list[str]:
    """The same counts over the cases that the true poses decide."""
    lines = []
    for what, detected in (("another action", outlier_found), ("mirrored", mirrored_found)):
        able = [r for r, t in zip(rows, true, strict=True) if detected(t)]
        count = sum(map(detected, able))
        lines.append(f"decided by the true poses: {what}: {count} of {len(able)}")
    still = [r for r, t in zip(rows, true, strict=True) if t.clean == "-"]
    alarms = sum(r.clean != "-" for r in still)
    return [
        *lines,
        f"nothing detected in the true poses, but in the fits: {alarms} of {len(still)}",
    ]


def outlier_found(row: TrustRow) -> bool:
    """Whether the replaced video and no other was detected as an outlier."""
    return row.found_outliers == row.replaced.split(" ")[0]


def mirrored_found(row: TrustRow) -> bool:
    """Whether the mirrored video and no other was detected, as mirrored or an outlier."""
    return row.found_mirrored == row.mirrored


def _row(
    name: str, names: Sequence[str], actions: Mapping[str, PoseVideos], max_rate: float
) -> TrustRow:
    videos = actions[name]
    M = len(videos.poses)
    rng = video_rng(name, 0, PURPOSE)
    v, w = (int(k) for k in rng.integers(0, M, 2))
    other = [n for n in names if n != name][int(rng.integers(0, len(names) - 1))]
    replacement = actions[other]
    source = min(v, len(replacement.poses) - 1)
    replaced = _with(videos, v, replacement.poses[source], replacement.fps[source])
    reflected = _with(videos, w, mirrored_poses(videos.poses[w], videos.twins), videos.fps[w])
    clean, outlier, mirror = (_screened(s, max_rate) for s in (videos, replaced, reflected))
    return TrustRow(
        action=name,
        clean=_named((*clean.outliers, *clean.mirrored)),
        clean_flipped=_named(clean.flipped),
        replaced=f"{_named((v,))} {other}",
        found_outliers=_named(outlier.outliers),
        mirrored=_named((w,)),
        found_mirrored=_named((*mirror.outliers, *mirror.mirrored)),
        flipped=_named(mirror.flipped),
        outlier_score=float(outlier.outlier_score[v]),
        clean_score=float(np.nanmax(clean.outlier_score)),
        mirror_margin=float(mirror.mirror_margin[w]),
        clean_margin=float(np.nanmax(clean.mirror_margin)),
    )


def _with(videos: PoseVideos, v: int, poses: np.ndarray, fps: float) -> PoseVideos:
    """The videos with one of them replaced."""
    every, rates = list(videos.poses), list(videos.fps)
    every[v], rates[v] = poses, fps
    return PoseVideos(every, rates, videos.twins)


def _screened(videos: PoseVideos, max_rate: float) -> Screening:
    scales = body_scales(videos.poses)
    return screen(
        [x / s for x, s in zip(videos.poses, scales, strict=True)],
        [np.ones(x.shape[:2]) for x in videos.poses],
        videos.fps,
        SyncParams(outliers="exclude", mirrored="flip", max_rate=max_rate),
        twins=videos.twins,
        declared=[None] * len(videos.poses),
    )


def _named(videos: Sequence[int]) -> str:
    return " ".join(f"v{v + 1}" for v in sorted({*videos})) or "-"

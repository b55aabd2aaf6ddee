"""`imocap benchmark trust`: are videos of another action, and mirrored ones, found?

Each action of trials is screened three times: as it is, with one video replaced by another
action's, and with one video mirrored. What is screened are the pipeline's own monocular fits; the
true poses are screened likewise, which tells what nobody can find.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.actions.captured import drawn
from imocap_core.sync.pairwise.poses import body_scales
from imocap_core.sync.screening.mirror import mirrored_poses
from imocap_core.sync.screening.screening import Screening, screen

Floats = NDArray[np.float64]

PURPOSE = 11  # of the random numbers: which video, and by which action it is replaced


@dataclass(frozen=True)
class Seen:
    """An action's videos: poses (T_v, J, 3), fps, and each joint's mirror twin (J,)."""

    poses: list[Floats]
    fps: list[float]
    twins: tuple[int, ...]


@dataclass(frozen=True)
class TrustRow:
    """One action: which video was replaced or mirrored, what was found in each case."""

    action: str
    clean: str  # called outliers or mirrored
    clean_flipped: str
    replaced: str  # video and the action it was replaced by
    found_outliers: str
    mirrored: str
    found_mirrored: str
    flipped: str
    outlier_score: float  # of the replaced video
    clean_score: float  # the largest without it
    mirror_margin: float  # of the mirrored video
    clean_margin: float


def measure(actions: Mapping[str, Seen], max_rate: float) -> list[TrustRow]:
    """One row an action, in the order of their names; `max_rate` as `sync.max_rate`."""
    names = sorted(actions)
    return [_row(name, names, actions, max_rate) for name in names]


def totals(rows: Sequence[TrustRow], of: str) -> list[str]:
    """How many were found, how often something that is not there was; `of` which poses."""
    n = len(rows)
    counts = {
        "the video of another action found, and no other": sum(map(outlier_found, rows)),
        "the mirrored video found, and no other": sum(map(mirrored_found, rows)),
        "it and no other flipped": sum(r.flipped == r.mirrored for r in rows),
        "something found where nothing is": sum(r.clean != "-" for r in rows),
        "a video flipped that is not mirrored": sum(r.clean_flipped != "-" for r in rows),
    }
    return [f"{of}: {what}: {count} of {n}" for what, count in counts.items()]


def among_decidable(rows: Sequence[TrustRow], true: Sequence[TrustRow]) -> list[str]:
    """The same of the cases that the true poses decide."""
    told = []
    for what, found in (("another action", outlier_found), ("mirrored", mirrored_found)):
        able = [r for r, t in zip(rows, true, strict=True) if found(t)]
        told.append(f"decided by the true poses: {what}: {sum(map(found, able))} of {len(able)}")
    still = [r for r, t in zip(rows, true, strict=True) if t.clean == "-"]
    alarms = sum(r.clean != "-" for r in still)
    return [*told, f"nothing in the true poses, and yet something found: {alarms} of {len(still)}"]


def outlier_found(row: TrustRow) -> bool:
    """Whether the replaced video and no other was called an outlier."""
    return row.found_outliers == row.replaced.split(" ")[0]


def mirrored_found(row: TrustRow) -> bool:
    """Whether the mirrored video and no other was called anything."""
    return row.found_mirrored == row.mirrored


def _row(name: str, names: Sequence[str], actions: Mapping[str, Seen], max_rate: float) -> TrustRow:
    seen = actions[name]
    M = len(seen.poses)
    rng = drawn(name, 0, PURPOSE)
    v, w = (int(k) for k in rng.integers(0, M, 2))
    other = [n for n in names if n != name][int(rng.integers(0, len(names) - 1))]
    stranger = actions[other]
    at = min(v, len(stranger.poses) - 1)
    strange = _with(seen, v, stranger.poses[at], stranger.fps[at])
    turned = _with(seen, w, mirrored_poses(seen.poses[w], seen.twins), seen.fps[w])
    clean, outlier, mirror = (_screened(s, max_rate) for s in (seen, strange, turned))
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


def _with(seen: Seen, v: int, poses: Floats, fps: float) -> Seen:
    """The videos with one of them replaced."""
    every, rates = list(seen.poses), list(seen.fps)
    every[v], rates[v] = poses, fps
    return Seen(every, rates, seen.twins)


def _screened(seen: Seen, max_rate: float) -> Screening:
    scales = body_scales(seen.poses)
    return screen(
        [x / s for x, s in zip(seen.poses, scales, strict=True)],
        [np.ones(x.shape[:2]) for x in seen.poses],
        seen.fps,
        outliers="exclude",
        mirrored="flip",
        twins=seen.twins,
        declared=[None] * len(seen.poses),
        max_rate=max_rate,
    )


def _named(videos: Sequence[int]) -> str:
    return " ".join(f"v{v + 1}" for v in sorted({*videos})) or "-"

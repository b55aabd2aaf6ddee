"""`imocap benchmark trust`: are videos of another action, and mirrored ones, found?

Each action of trials is filmed as four simulated estimates and screened three times: as it is,
with one video replaced by another action's, and with one video mirrored. No motion is solved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imocap_core.conventions import EVAL_14, mirror_indices
from imocap_core.sync.mirror import mirrored_poses
from imocap_core.sync.poses import body_scales
from imocap_core.sync.screening import Screening, screen
from imocap_core.synthetic.captured import VIEWPOINTS, place_camera
from imocap_core.synthetic.estimator import estimate
from stages.benchmarks.inputs import SIZE, Shot, drawn, trial_shots
from stages.params import SyncParams

Floats = NDArray[np.float64]

VIDEOS = 4
TWINS = mirror_indices(EVAL_14)
PURPOSE = 11  # of the random numbers: which video, and by which action it is replaced


@dataclass(frozen=True)
class TrustRow:
    """One action: which video was replaced or mirrored, what was found in each case."""

    action: str
    clean: str
    replaced: str  # video and the action it was replaced by
    found_outliers: str
    mirrored: str
    found_mirrored: str
    outlier_score: float  # of the replaced video
    clean_score: float  # the largest without it
    mirror_margin: float  # of the mirrored video
    clean_margin: float


def measure(folder: Path, params: SyncParams) -> list[TrustRow]:
    """One row an action file below `folder`; of `params` only the largest rate counts."""
    files = sorted(folder.glob("*.npz"))
    return [_row(file, files, params) for file in files]


def totals(rows: Sequence[TrustRow]) -> list[str]:
    """How many were found, and how often something was found that is not there."""
    n = len(rows)
    outliers = sum(r.found_outliers == r.replaced.split(" ")[0] for r in rows)
    mirrored = sum(r.found_mirrored == r.mirrored for r in rows)
    clean = sum(r.clean != "-" for r in rows)
    return [
        f"the video of another action found, and no other: {outliers} of {n}",
        f"the mirrored video found, and no other: {mirrored} of {n}",
        f"something found where nothing is: {clean} of {n}",
    ]


def _row(file: Path, files: Sequence[Path], params: SyncParams) -> TrustRow:
    shots = trial_shots(file, VIDEOS)
    rng = drawn(file.stem, 0, PURPOSE)
    v, w = (int(k) for k in rng.integers(0, VIDEOS, 2))
    other = [f for f in files if f != file][int(rng.integers(0, len(files) - 1))]
    seen = [_filmed(shot, k, file.stem) for k, shot in enumerate(shots)]
    fps = [shot.fps for shot in shots]
    strange, turned = list(seen), list(seen)
    strange[v] = _filmed(trial_shots(other, 1)[0], v, f"{file.stem} {other.stem}")
    turned[w] = mirrored_poses(seen[w], TWINS)
    clean, outlier, mirror = (_screened(x, fps, params) for x in (seen, strange, turned))
    return TrustRow(
        action=file.stem,
        clean=_named((*clean.outliers, *clean.mirrored)),
        replaced=f"{_named((v,))} {other.stem}",
        found_outliers=_named(outlier.outliers),
        mirrored=_named((w,)),
        found_mirrored=_named((*mirror.outliers, *mirror.mirrored)),
        outlier_score=float(outlier.outlier_score[v]),
        clean_score=float(np.nanmax(clean.outlier_score)),
        mirror_margin=float(mirror.mirror_margin[w]),
        clean_margin=float(np.nanmax(clean.mirror_margin)),
    )


def _filmed(shot: Shot, view: int, name: str) -> Floats:
    """A simulated monocular estimate (T, 14, 3) of a performance from one of four sides."""
    _, R, t = place_camera(VIEWPOINTS[view], shot.joints_m, SIZE)
    return estimate(shot.joints_m @ R.T + t, shot.fps, drawn(name, view, PURPOSE + 1))


def _screened(poses: Sequence[Floats], fps: Sequence[float], params: SyncParams) -> Screening:
    scales = body_scales(poses)
    return screen(
        [x / s for x, s in zip(poses, scales, strict=True)],
        [np.ones(x.shape[:2]) for x in poses],
        fps,
        outliers="exclude",
        mirrored="flip",
        twins=TWINS,
        declared=[None] * len(poses),
        max_rate=params.max_rate,
    )


def _named(videos: Sequence[int]) -> str:
    return " ".join(f"v{v + 1}" for v in sorted({*videos})) or "-"

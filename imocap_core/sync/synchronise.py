"""Synchronisation of videos by the 3D poses seen in them (section 3.1), from poses to warps."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imocap_core.sync.affinity import gaussian_affinity, reciprocal_affinity
from imocap_core.sync.comparison import centrality_of, compare
from imocap_core.sync.cycle import relax, relax_auto
from imocap_core.sync.paths import dtw_warps
from imocap_core.sync.poses import check_poses
from imocap_core.sync.posterior import directed_maps, posterior_warps
from imocap_core.sync.report import CycleReport
from imocap_core.sync.settings import Settings

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SyncResult:
    """Where every frame of every video lies in the reference video."""

    reference: int
    reference_frame: list[
        Array
    ]  # per video (T_v,) fractional index into the reference; NaN unmatched
    confidence: list[Array]  # per video (T_v,) in [0, 1]
    affinity: NDArray[np.float32]  # (N_a, N_a)
    relaxed: NDArray[np.float32]  # (N_a, N_a), row-stochastic per block
    centrality: Array  # (M,), the reference has the largest unless it was given
    matched_square: float  # squared distance typical of matching frames
    cycle: CycleReport
    status: str


def synchronise(
    poses: Sequence[Array],
    *,
    fps: Sequence[float],
    settings: Settings,
    rng: np.random.Generator,
    confidence: Sequence[Array] | None = None,
    joint_weights: Array | None = None,
    reference: int | None = None,
) -> SyncResult:
    """Find for every frame of every video its counterpart in the reference video.

    `poses`: per video (T_v, J, 3), one unit for all, any axes and origin (each pose is aligned
    rigidly), NaN = missing; `fps` per video; `confidence` per video (T_v, J) in [0, 1];
    `joint_weights` (J,); `reference`: the index of the reference video, chosen by centrality when
    None. Raises ValueError for shapes that don't fit.
    """
    check_poses(poses, confidence, fps)
    if reference is not None and not 0 <= reference < len(poses):
        raise ValueError(f"reference: expected 0 to {len(poses) - 1}, got {reference}")
    c = compare(poses, confidence, joint_weights, settings)
    to_affinity = {"reciprocal": reciprocal_affinity, "gaussian": gaussian_affinity}
    if settings.affinity not in to_affinity:
        raise ValueError(f"affinity: expected reciprocal or gaussian, got {settings.affinity!r}")
    affinity = to_affinity[settings.affinity](np.sqrt(c.squares), np.sqrt(c.near))
    c.blocks.set_diagonal_to_identity(affinity)

    maps, matched = directed_maps(c, fps, settings)
    centrality = centrality_of(c, maps, matched)
    chosen = int(np.argmax(centrality)) if reference is None else reference
    evidence = maps if settings.warp == "posterior" else affinity
    if settings.method == "auto":
        relaxed, report = relax_auto(evidence, c.blocks, rounds=settings.rounds, rng=rng)
    else:
        relaxed, report = relax(
            settings.method, evidence, c.blocks, rounds=settings.rounds, rng=rng
        )
    if settings.warp == "posterior":
        frames, trust = posterior_warps(c, relaxed, matched, chosen, fps, settings)
    elif settings.warp == "dtw":
        frames, trust = dtw_warps(c, relaxed, maps, chosen, fps, settings)
    else:
        raise ValueError(f"warp: expected posterior or dtw, got {settings.warp!r}")
    frames[chosen], trust[chosen] = (
        np.arange(float(len(poses[chosen]))),
        np.ones(len(poses[chosen])),
    )
    return SyncResult(
        chosen,
        frames,
        trust,
        affinity.astype(np.float32),
        relaxed.astype(np.float32),
        centrality,
        c.near,
        report,
        _status(frames, trust, chosen, report),
    )


def _status(frames: list[Array], trust: list[Array], reference: int, report: CycleReport) -> str:
    """One sentence on what was found."""
    others = [v for v in range(len(frames)) if v != reference]
    if not others:
        return "one video: nothing to synchronise"
    share = np.mean(np.concatenate([np.isfinite(frames[v]) for v in others]))
    certain = np.mean(np.concatenate([trust[v] for v in others]))
    return (
        f"{100 * share:.0f} % of the frames matched, mean confidence {certain:.2f}; {report.status}"
    )

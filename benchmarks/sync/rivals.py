"""Rivals of the sync benchmark: TCC on the same estimated poses, and clips stretched evenly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.sync.scenes import SyncScene
from benchmarks.tcc import POSES, TccSettings, align_by_tcc
from imocap_core.conventions import EVAL_14

Floats = NDArray[np.float64]
Found = tuple[list[Floats], list[Floats]]  # reference frames and confidences, per video (T_v,)

RIVALS = ("tcc", "stretch")
HIPS = [EVAL_14.index(f"{side}_hip") for side in ("left", "right")]


def rival(
    kind: str, scene: SyncScene, reference: int, *, seed: int = 0, tcc: TccSettings = POSES
) -> Found:
    """Maps into the reference by one of RIVALS. ValueError for another name."""
    if kind not in RIVALS:
        raise ValueError(f"kind: expected one of {', '.join(RIVALS)}, got {kind!r}")
    if kind == "stretch":
        last = float(len(scene.poses[reference]) - 1)
        frames = [np.linspace(0.0, last, len(x)) for x in scene.poses]
        return frames, [np.ones(len(x)) for x in scene.poses]
    clips = [rooted(x) for x in scene.poses]
    found = align_by_tcc(clips, scene.fps, tcc, reference=reference, seed=seed)
    return found.reference_frame, found.confidence


def rooted(poses: Floats) -> NDArray[np.float32]:
    """Estimated poses (T, 14, 3) about the hips, in units of the body's size in the clip."""
    about = poses - poses[:, HIPS].mean(axis=1, keepdims=True)
    size = float(np.median(np.sqrt((about**2).sum(axis=-1).mean(axis=1))))
    return np.asarray(about / max(size, 1e-9), np.float32)

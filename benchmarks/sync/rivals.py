"""Rivals of the synchronisation: TCC on the same estimated poses, and clips stretched evenly."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32

from benchmarks.sync.scenes import SyncScene
from benchmarks.tcc import POSES, TccSettings, align_by_tcc
from imocap_core.conventions import EVAL_14

# Reference frames and confidences, per video.
Maps = tuple[list[Float[np.ndarray, " T"]], list[Float[np.ndarray, " T"]]]

RIVALS = ("tcc", "stretch")
HIPS = [EVAL_14.index(f"{side}_hip") for side in ("left", "right")]


def rival(
    kind: str, scene: SyncScene, reference: int, *, seed: int = 0, tcc: TccSettings = POSES
) -> Maps:
    """Maps into the reference by one of RIVALS. ValueError for another name."""
    if kind not in RIVALS:
        raise ValueError(f"kind: expected one of {', '.join(RIVALS)}, got {kind!r}")
    if kind == "stretch":
        last = float(len(scene.poses[reference]) - 1)
        frames = [np.linspace(0.0, last, len(x)) for x in scene.poses]
        return frames, [np.ones(len(x)) for x in scene.poses]
    clips = [rooted(x) for x in scene.poses]
    alignment = align_by_tcc(clips, scene.fps, tcc, reference=reference, seed=seed)
    return alignment.reference_frame, alignment.confidence


def rooted(poses: Float[np.ndarray, "T 14 3"]) -> Float32[np.ndarray, "T 14 3"]:
    """Estimated poses relative to the hips, in units of the body's size in the clip."""
    about = poses - poses[:, HIPS].mean(axis=1, keepdims=True)
    size = float(np.median(np.sqrt((about**2).sum(axis=-1).mean(axis=1))))
    return np.asarray(about / max(size, 1e-9), np.float32)

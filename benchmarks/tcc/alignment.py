"""From embeddings to positions in the reference, by the DTW of the pipeline's synchronisation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from benchmarks.tcc.clips import TccClip
from benchmarks.tcc.loss import soft_matches, squared_distances
from benchmarks.tcc.settings import TccSettings
from benchmarks.tcc.training import train
from imocap_core.sync.warp.dtw import dtw, positions_of_rows
from imocap_core.sync.warp.template import mass_within


@dataclass(frozen=True)
class TccAlignment:
    """The position of every frame in the reference; the first three as in `sync.SyncResult`."""

    reference: int
    reference_frame: list[Float[np.ndarray, " T"]]  # per video, fractional; NaN unmatched
    confidence: list[Float[np.ndarray, " T"]]  # per video, in [0, 1]
    losses: list[float]  # of the training, one a step; empty without training


def align_by_tcc(
    clips: Sequence[TccClip],
    fps: Sequence[float],
    settings: TccSettings,
    *,
    reference: int,
    seed: int,
    device: str = "cpu",
) -> TccAlignment:
    """Train on the clips (`pose_clip` or `frame_clip`, one a video), then align them to one."""
    trained = train(clips, fps, settings, seed=seed, device=device)
    return align(trained.embeddings, fps, settings, reference=reference, losses=trained.losses)


def align(
    embeddings: Sequence[Float[np.ndarray, "T D"]],
    fps: Sequence[float],
    settings: TccSettings,
    *,
    reference: int,
    losses: Sequence[float] = (),
) -> TccAlignment:
    """DTW of each video's embeddings with the reference's.

    With a finite `unmatched_level` the ends are open: a frame before the path's start or after its
    end costs this share of the way from the usual distance of matching frames to that of any two
    frames. ValueError for an unknown reference.
    """
    if not 0 <= reference < len(embeddings):
        raise ValueError(f"reference: expected 0 to {len(embeddings) - 1}, got {reference}")
    target = torch.as_tensor(embeddings[reference])
    reach = settings.confidence_reach_s * fps[reference]
    frames, confidence = [], []
    for v, embedding in enumerate(embeddings):
        z = torch.as_tensor(embedding)
        cost = squared_distances(z, target).sqrt().numpy()
        if v == reference:
            position = np.arange(float(len(embedding)))
        else:
            path, _ = dtw(cost, skip=_skip_of(cost, settings.unmatched_level))
            position = positions_of_rows(path, len(embedding))
        soft = soft_matches(z, target, settings.temperature).numpy()
        certain = mass_within(soft, np.nan_to_num(position), reach)
        frames.append(position)
        confidence.append(np.where(np.isfinite(position), np.clip(certain, 0.0, 1.0), 0.0))
    confidence[reference] = np.ones(len(embeddings[reference]))
    return TccAlignment(reference, frames, confidence, list(losses))


def _skip_of(cost: np.ndarray, share: float) -> float:
    if not np.isfinite(share):
        return np.inf
    near, usual = float(np.median(cost.min(axis=1))), float(np.median(cost))
    return near + share * (usual - near)

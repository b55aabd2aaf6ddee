"""From embeddings to positions in the reference, by the DTW that our own method uses."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from benchmarks.tcc.clips import Clip
from benchmarks.tcc.loss import soft_matches, squared_distances
from benchmarks.tcc.settings import TccSettings
from benchmarks.tcc.training import train
from imocap_core.sync.warp.dtw import dtw, positions_of_rows
from imocap_core.sync.warp.positions import mass_within

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TccAlignment:
    """Where every frame lies in the reference; the first three as in `sync.SyncResult`."""

    reference: int
    reference_frame: list[Array]  # per video (T,) index into the reference; NaN unmatched
    confidence: list[Array]  # per video (T,) in [0, 1]
    losses: list[float]  # of the training, one a step; empty when there was none


def align_by_tcc(
    clips: Sequence[Clip],
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
    embeddings: Sequence[Array],
    fps: Sequence[float],
    settings: TccSettings,
    *,
    reference: int,
    losses: Sequence[float] = (),
) -> TccAlignment:
    """DTW of each video's embeddings (T, D) with the reference's.

    With a finite `unmatched_level` the ends are open: a frame before the path's start or after its
    end pays a cost that lies that share of the way from that of matching frames to that of any two
    frames. ValueError for an unknown reference.
    """
    if not 0 <= reference < len(embeddings):
        raise ValueError(f"reference: expected 0 to {len(embeddings) - 1}, got {reference}")
    target = torch.as_tensor(embeddings[reference])
    reach = settings.confidence_reach_s * fps[reference]
    frames, trust = [], []
    for v, own in enumerate(embeddings):
        z = torch.as_tensor(own)
        cost = squared_distances(z, target).sqrt().numpy()
        if v == reference:
            position = np.arange(float(len(own)))
        else:
            path, _ = dtw(cost, skip=_skip_of(cost, settings.unmatched_level))
            position = positions_of_rows(path, len(own))
        soft = soft_matches(z, target, settings.temperature).numpy()
        certain = mass_within(soft, np.nan_to_num(position), reach)
        frames.append(position)
        trust.append(np.where(np.isfinite(position), np.clip(certain, 0.0, 1.0), 0.0))
    trust[reference] = np.ones(len(embeddings[reference]))
    return TccAlignment(reference, frames, trust, list(losses))


def _skip_of(cost: Array, level: float) -> float:
    if not np.isfinite(level):
        return np.inf
    near, usual = float(np.median(cost.min(axis=1))), float(np.median(cost))
    return near + level * (usual - near)

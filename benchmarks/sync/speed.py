"""Time and memory of each part of the synchronisation at several sizes."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from imocap_core.params import SyncParams
from imocap_core.params.sync_params import CycleMethod
from imocap_core.sync import SyncEvidence, synchronise
from imocap_core.sync.affinity import distance_matrix
from imocap_core.sync.cycle import relax, symmetric_affinity
from imocap_core.sync.maps import BlockMaps
from imocap_core.sync.reference import compared_pairs
from imocap_core.sync.warp.soft_maps import Clocks

SIZES = (600, 1200, 1550, 4000)
LARGEST = {"als": 1550, "svt": 1200}  # beyond it a method is not measured
VIDEOS, JOINTS, FPS = 4, 24, 30.0


@dataclass(frozen=True)
class SpeedRow:
    """One part at one size; growth: exponent of the seconds by frames since the size before."""

    part: str
    frames: int
    seconds: float
    peak_mb: float
    growth: float
    status: str


def made_poses(frames: int, rng: np.random.Generator) -> list[Float[np.ndarray, "T 24 3"]]:
    """Four noisy copies of one smooth motion, frames / 4 frames each, metres."""
    T = frames // VIDEOS
    motion = 0.3 * gaussian_filter1d(rng.normal(size=(T, JOINTS, 3)), 8.0, axis=0) * 5.0
    return [motion + 0.05 * rng.normal(size=motion.shape) for _ in range(VIDEOS)]


def speed(settings: SyncParams) -> list[SpeedRow]:
    """Affinity, each cycle-consistency method and the whole synchronisation."""
    rows: list[SpeedRow] = []
    fps = [FPS] * VIDEOS
    for size in SIZES:
        poses = made_poses(size, np.random.default_rng(size))
        work = partial(distance_matrix, poses, None, fps, settings)
        rows.append(_row(rows, "affinity", size, work))
        distances = work()
        blocks = distances.blocks
        clocks = Clocks(fps, np.ones(VIDEOS))
        maps = compared_pairs(distances, clocks, settings, range(VIDEOS)).soft_maps
        affinity = BlockMaps.of(symmetric_affinity(maps.dense(), blocks), blocks)
        for method in ("softmap", "als", "svt"):
            if size <= LARGEST.get(method, size):
                relaxed = partial(_relaxed, method, affinity, settings.rounds)
                rows.append(_row(rows, method, size, relaxed))
        rows.append(_row(rows, "whole, default", size, partial(_whole, poses, fps, settings)))
    return rows


def _relaxed(method: CycleMethod, affinity: BlockMaps, rounds: int) -> str:
    return relax(method, affinity, rounds=rounds, rng=np.random.default_rng(0))[1].status


def _whole(poses: list[np.ndarray], fps: list[float], settings: SyncParams) -> None:
    synchronise(SyncEvidence(poses, fps), settings, np.random.default_rng(0))


def _row(rows: list[SpeedRow], part: str, size: int, work: Callable[[], object]) -> SpeedRow:
    began = time.perf_counter()
    result = work()
    seconds = time.perf_counter() - began
    tracemalloc.start()
    work()
    peak = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    before = [r for r in rows if r.part == part]
    growth = (
        float(np.log(seconds / before[-1].seconds) / np.log(size / before[-1].frames))
        if before
        else float("nan")
    )
    return SpeedRow(part, size, seconds, peak, growth, result if isinstance(result, str) else "")

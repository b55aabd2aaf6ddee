"""Time and memory of SMPL-BA by number of frames, every size in its own process."""

from __future__ import annotations

import multiprocessing
import os
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.scoring.costs import peak_gb
from benchmarks.solver.scene import made_scene
from imocap_core.motion.multiview.smpl_ba import recover_motion
from imocap_core.params import FitParams, MotionParams

SIZES = ((4, 150), (4, 300), (8, 500), (8, 1000))


@dataclass(frozen=True)
class GrowthRow:
    """SMPL-BA on one made scene.

    seconds: on the clock; processor_s: of all cores together. growth: exponent of the processor's
    seconds by frames since the size before. load: mean number of processes ready to run in
    the minute before.
    """

    videos: int
    frames: int
    seconds: float
    processor_s: float
    processor_ms_per_frame: float
    peak_gb: float
    growth: float
    load: float


def grow(
    fit: FitParams, motion: MotionParams, seed: int, sizes: tuple[tuple[int, int], ...] = SIZES
) -> list[GrowthRow]:
    """All sizes, the smallest first."""
    rows: list[GrowthRow] = []
    spawn = multiprocessing.get_context("spawn")
    for videos, frames in sizes:
        with ProcessPoolExecutor(1, mp_context=spawn) as pool:
            row = pool.submit(measure_size, fit, motion, seed, videos, frames).result()
        rows.append(_with_growth(row, rows))
    return rows


def measure_size(
    fit: FitParams, motion: MotionParams, seed: int, videos: int, frames: int
) -> GrowthRow:
    """The row of one size, measured in this process."""
    load = os.getloadavg()[0]
    made = made_scene(videos, frames, fit, seed)
    began, began_processor = time.perf_counter(), time.process_time()
    recover_motion(made.scene, made.start, motion)
    seconds, processor_s = time.perf_counter() - began, time.process_time() - began_processor
    per_frame = 1e3 * processor_s / (videos * frames)
    return GrowthRow(videos, frames, seconds, processor_s, per_frame, peak_gb(), float("nan"), load)


def _with_growth(row: GrowthRow, before: list[GrowthRow]) -> GrowthRow:
    if not before:
        return row
    last = before[-1]
    more = (row.videos * row.frames) / (last.videos * last.frames)
    growth = float(np.log(row.processor_s / last.processor_s) / np.log(more))
    return replace(row, growth=growth)

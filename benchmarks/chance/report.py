"""`imocap benchmark chance`: how often compare's test tells two sets of performances apart.

Captured joints, without detector and fit: two sets of one kind, drawn from many takes of one
action, in which the test should find something in one of twenty at most; and sets of two walkers.
Each set is synchronised by itself and the sets' means with each other, as `imocap compare` does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from rich.table import Table

from benchmarks.actions.captured import data_folder
from benchmarks.chance.takes import CapturedTake, takes_of
from benchmarks.names import BenchmarkOptions, table_of_rows
from benchmarks.tables import write_rows
from imocap_core.compare.parts import LIKELY, chance_of
from imocap_core.motion.multiview.timeline import values_at
from imocap_core.params import SyncParams
from imocap_core.pipeline.runner import Display
from imocap_core.sync.evidence import SyncEvidence
from imocap_core.sync.synchronise import synchronise
from imocap_core.workspace import Workspace

NAME, SEED = "chance", 5
ONE_KIND = ("performances", "bandai_raise_right_hand")
WALKERS = (("trials", "cmu_walk_s07"), ("performers", "cmu_walk_s08"))
SETTINGS = replace(SyncParams(), outliers="ignore", mirrored="ignore")
DRAWS, OF_WALKERS = 40, 4


@dataclass(frozen=True)
class ChanceRow:
    """Of draws of two sets, in how many the test told them apart, and the median of the least
    probabilities."""

    sets: str
    performances: str
    draws: int
    told_apart: int
    median_p: float


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """A row a kind and size of sets; `videos` is the size."""
    takes = [
        takes_of(data_folder(workspace.root, kind) / f"{name}.npz")
        for kind, name in (ONE_KIND, *WALKERS)
    ]
    rng, size = np.random.default_rng(SEED), options.videos
    of_one = [_drawn(takes[0], 2 * size, rng) for _ in range(DRAWS)]
    alike = [(drawn[:size], drawn[size:]) for drawn in of_one]
    apart = [(_drawn(takes[1], size, rng), _drawn(takes[2], size, rng)) for _ in range(OF_WALKERS)]
    rows = []
    for sets, draws in (("one kind", alike), ("two walkers", apart)):
        p = np.array([least_probability(first, second, rng) for first, second in draws])
        apart_in = int((p <= LIKELY).sum())
        rows.append(ChanceRow(sets, f"{size} and {size}", len(p), apart_in, float(np.median(p))))
    folder = workspace.root / "artifacts" / "benchmark" / NAME
    write_rows(folder, "results", rows)
    return [table_of_rows(rows), f"Written to {folder}"]


def _drawn(takes: list[CapturedTake], size: int, rng: np.random.Generator) -> list[CapturedTake]:
    return [takes[k] for k in rng.permutation(len(takes))[:size]]


def least_probability(
    first: list[CapturedTake], second: list[CapturedTake], rng: np.random.Generator
) -> float:
    """Of all angles of two sets of performances."""
    ours, theirs = (_on_one_axis([take.joints for take in takes], rng) for takes in (first, second))
    means = [np.nanmean(of, axis=0) for of in (ours, theirs)]
    position = _positions(means, rng)[1]
    shown = np.isfinite(position)
    curves = [
        [first[0].angles_deg(of[shown]) for of in ours],
        [second[0].angles_deg(_at(of, position[shown])) for of in theirs],
    ]
    of_first, of_second = (
        {name: np.stack([angles[name] for angles in each]) for name in each[0]} for each in curves
    )
    return min(chance_of(of_first, of_second, rng).p.values())


def _on_one_axis(
    motions: list[Float[np.ndarray, "_T J 3"]], rng: np.random.Generator
) -> list[Float[np.ndarray, "N J 3"]]:
    """All motions at the frames of the first, NaN where they do not show them."""
    return [_at(x, position) for x, position in zip(motions, _positions(motions, rng), strict=True)]


def _positions(
    motions: list[Float[np.ndarray, "_T J 3"]], rng: np.random.Generator
) -> list[Float[np.ndarray, " N"]]:
    """Of each motion, the frame that matches each frame of the first, NaN where none does."""
    evidence = SyncEvidence(motions, fps=[CapturedTake.fps] * len(motions), reference=0)
    frames = np.arange(len(motions[0]), dtype=np.float64)
    positions = [frames]
    for matched in synchronise(evidence, SETTINGS, rng).reference_frame[1:]:
        matched_frames = np.flatnonzero(np.isfinite(matched))
        ends = {"left": np.nan, "right": np.nan}
        positions.append(np.interp(frames, matched[matched_frames], matched_frames, **ends))
    return positions


def _at(
    motion: Float[np.ndarray, "T J 3"], position: Float[np.ndarray, " N"]
) -> Float[np.ndarray, "N J 3"]:
    values = values_at(motion, np.nan_to_num(position))
    return np.where(np.isfinite(position)[:, None, None], values, np.nan)

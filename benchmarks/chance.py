"""`imocap benchmark chance`: what compare's permutation test finds between sets of performances."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from rich.table import Table

from benchmarks.actions.captured_videos import data_folder
from benchmarks.names import BenchmarkOptions
from benchmarks.tables import table_of_rows, write_rows
from imocap_core.compare.parts import LIKELY, chance_of
from imocap_core.motion.multiview.timeline import values_at
from imocap_core.params import SyncParams
from imocap_core.pipeline.runner import Display
from imocap_core.sync.evidence import SyncEvidence
from imocap_core.sync.synchronise import synchronise
from imocap_core.workspace import Workspace

# Captured takes of one action: joints about the hips, facing one way, and angles of the limbs.

BENDS = (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle"))
DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True, eq=False)
class CapturedTake:
    """One take at 30 frames a second; joints: (T, J, 3) metres, z up; names: of the joints."""

    fps: ClassVar[float] = 30.0
    joints: Float[np.ndarray, "T J 3"]
    names: tuple[str, ...]

    def angles_deg(self, joints: Float[np.ndarray, "N J 3"]) -> dict[str, Float[np.ndarray, " N"]]:
        """Bend of elbows and knees, and how far upper arms and thighs are raised from the
        vertical; joints: of any take with these names."""
        angles = {}
        for side in "lr":
            for bend in BENDS:
                upper, middle, end = (
                    joints[:, self.names.index(f"{side}_{name}")] for name in bend
                )
                angles[f"{side}_{bend[1]}"] = between_deg(middle - upper, end - middle)
                angles[f"{side}_{bend[0]}"] = between_deg(middle - upper, DOWN)
        return angles


def takes_of(file: Path) -> list[CapturedTake]:
    """All takes of a file of captured motion, about the hips, the hips of the first frame along
    x."""
    with np.load(file) as data:
        names, index = tuple(map(str, data["common14"])), data["common14_idx"]
        step = max(1, round(float(data["fps"]) / CapturedTake.fps))
        up = json.loads(str(data["meta"])).get("up", "y")
        count = len(data["trial_ids"])
        motions = [data[f"trial_{k:02d}"][::step][:, index].astype(float) for k in range(count)]
    if up == "y":
        motions = [motion[..., [2, 0, 1]] for motion in motions]
    return [CapturedTake(_about_hips(motion, names), names) for motion in motions]


def _about_hips(
    joints: Float[np.ndarray, "T J 3"], names: tuple[str, ...]
) -> Float[np.ndarray, "T J 3"]:
    left, right = (joints[:, names.index(f"{side}_hip")] for side in "lr")
    x, y, _ = left[0] - right[0]
    turn = np.arctan2(y, x)
    c, s = np.cos(turn), np.sin(turn)
    R = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray((joints - (left + right)[:, None] / 2) @ R.T)


def between_deg(
    a: Float[np.ndarray, "N 3"], b: Float[np.ndarray, "*N 3"]
) -> Float[np.ndarray, " N"]:
    """Angle between directions."""
    product = (a * b).sum(-1) / np.linalg.norm(a, axis=-1) / np.linalg.norm(b, axis=-1)
    return np.rad2deg(np.arccos(np.clip(product, -1.0, 1.0)))


# `imocap benchmark chance`: how often compare's test tells two sets of performances apart.
#
# Captured joints, without detector and fit: two sets of one kind, drawn from many takes of one
# action, in which the test should find something in one of twenty at most; and sets of two walkers.
# Each set is synchronised by itself and the sets' means with each other, as `imocap compare` does.

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

"""`imocap benchmark performances`: one action by 2, 4, 8, ... performances, and how they differ."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from rich.table import Table

from benchmarks.actions.captured_videos import data_folder
from benchmarks.actions.performers import ready_takes
from benchmarks.angles import bend_deg
from benchmarks.names import BenchmarkOptions
from benchmarks.parallel import ActionDisplay
from benchmarks.scoring import score_action
from benchmarks.tables import table_of_rows, write_rows
from imocap_core.compare.compare import describe, performances_of
from imocap_core.library.result import Result
from imocap_core.motion.multiview.timeline import values_at
from imocap_core.pipeline import runner
from imocap_core.pipeline.runner import Display, Job
from imocap_core.workspace import Workspace

# `imocap benchmark performances`: accuracy by the number of performances, and their distribution.
#
# The first takes of one action in sets of 2, 4, 8, ..., up to `--videos`: each set size shows the
# same takes. Of the distribution: what `Result.variation` says of the joint angles' standard
# deviations and of the first mode, against the captured takes at the same correspondences.

NAME, FILE = "performances", "bandai_raise_right_hand.npz"
LEAST_SD_DEG = 2.0  # of an angle that performances differ in: of less, detections tell nothing
ENDS = {  # of an angle, the joints that it is between
    "elbow_flexion": ("shoulder", "elbow", "wrist"),
    "knee_flexion": ("hip", "knee", "ankle"),
}


@dataclass(frozen=True)
class PerformancesRow:
    """Means over the sets of one size: errors in mm, and the oracle's; of the angles' standard
    deviations, the median ratio to the true ones, as solved and with what videos leave open; the
    correlation of the first mode's scores with the true one's; seconds a set."""

    videos: int
    sets: int
    mpjpe_scaled_mm: float
    pa_mpjpe_mm: float
    oracle_mpjpe_scaled_mm: float
    oracle_pa_mpjpe_mm: float
    sd_ratio_solved: float
    sd_ratio: float
    first_mode_correlation: float
    seconds: float


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """A row a size of the sets."""
    file = data_folder(workspace.root, NAME) / FILE
    folder = workspace.root / "artifacts" / "benchmark" / f"{NAME}-{options.detector}"
    rows = []
    for size in sizes(options.videos):
        sets = []
        for first in range(0, options.videos - size + 1, size):
            shown = ActionDisplay(display, f"{size} from {first}")
            job = ready_takes(folder, file, first, size, options.detector, shown)
            sets.append(_measured(job, shown, folder))
        means = np.nanmean(np.array(sets), axis=0).tolist()
        rows.append(PerformancesRow(size, len(sets), *means))
        write_rows(folder, "results", rows)
    return [table_of_rows(rows), f"Written to {folder}"]


def sizes(most: int) -> Iterator[int]:
    """2, 4, 8, ... up to the number of takes."""
    size = 2
    while size <= most:
        yield size
        size *= 2


def _measured(job: Job, display: Display, folder: Path) -> list[float]:
    began = time.perf_counter()
    runner.run(job, display, job.pipeline.upstream("uncertainty"))
    seconds = time.perf_counter() - began
    score = score_action(job, display, folder / "scores" / f"{job.action.name}.json", folder)
    solved, oracle = (score.numbers[name] for name in ("after loop", "oracle"))
    errors = [of[f"{m}_mm"] for of in (solved, oracle) for m in ("mpjpe_scaled", "pa_mpjpe")]
    return [*errors, *distribution(Result.of_action(job.store, job.action), job), seconds]


def distribution(result: Result, job: Job) -> tuple[float, float, float]:
    """Median ratio of standard deviations, as solved and in all, and correlation of first modes."""
    technique = describe(performances_of(result))
    variation, of_each = result.variation, technique.performances
    frames = [
        clock * result[video].fps
        for video, clock in zip(variation.ids, of_each.clock_s, strict=True)
    ]
    assert job.action.truth is not None
    with np.load(job.action.folder / job.action.truth) as truth:
        names = [str(name) for name in truth["joint_names"]]
        true = [
            values_at(truth[f"{video}/joints"], frame)
            for video, frame in zip(variation.ids, frames, strict=True)
        ]
    ratios = []
    for angle, ends in ENDS.items():
        for side in ("left", "right"):
            joints = [names.index(f"{side}_{end}") for end in ends]
            true_sd = _rms(np.std([bend_deg(x[:, joints]) for x in true], axis=0, ddof=1))
            if true_sd >= LEAST_SD_DEG:
                band = variation.angles[f"{side}_{angle}"]
                left_open = of_each.open_deg[f"{side}_{angle}"]
                whole = _rms(band.sd_deg)
                solved = np.sqrt(max(whole**2 - float(np.mean(left_open**2)), 0.0))
                ratios.append((solved / true_sd, whole / true_sd))
    solved_ratio, ratio = np.median(ratios, axis=0) if ratios else (np.nan, np.nan)
    scores = technique.modes.scores[:, 0]
    return float(solved_ratio), float(ratio), _correlation(scores, _first_scores(true, names))


def _first_scores(
    true: list[Float[np.ndarray, "N J 3"]], names: list[str]
) -> Float[np.ndarray, " M"]:
    """Scores of the first principal component of captured takes, about the hips, facing alike."""
    hips = [names.index(f"{side}_hip") for side in ("left", "right")]
    rows = []
    for joints in true:
        about = joints - joints[:, hips].mean(axis=1, keepdims=True)
        x, y, _ = (about[:, hips[0]] - about[:, hips[1]]).mean(axis=0)
        c, s = np.array([x, y]) / np.hypot(x, y)
        rows.append((about @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])).ravel())
    centred = np.array(rows) - np.mean(rows, axis=0)
    U, sigma, _ = np.linalg.svd(centred, full_matrices=False)
    return np.asarray(U[:, 0] * sigma[0])


def _correlation(a: Float[np.ndarray, " M"], b: Float[np.ndarray, " M"]) -> float:
    return abs(float(np.corrcoef(a, b)[0, 1])) if len(a) > 2 else float("nan")


def _rms(values: Float[np.ndarray, " N"]) -> float:
    return float(np.sqrt(np.nanmean(values**2)))

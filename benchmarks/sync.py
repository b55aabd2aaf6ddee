"""`imocap benchmark sync`: synchronisation alone."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import numpy as np
from jaxtyping import Float, Float32
from rich.table import Table
from scipy.ndimage import gaussian_filter1d

from benchmarks.actions.captured_videos import data_folder
from benchmarks.names import BenchmarkOptions
from benchmarks.sync_playback import FACTORS, freeze_frames, slow_motion
from benchmarks.sync_reliability import reliability
from benchmarks.sync_scenes import SyncScene, protocol_scene, trial_scene
from benchmarks.tables import finite_mean, markdown_of_rows, write_rows
from benchmarks.tcc import POSES, TccSettings, align_by_tcc
from imocap_core.conventions import EVAL_14
from imocap_core.errors import WrongUse
from imocap_core.metrics.sync import matched_share, sync_error_frames, sync_error_pct, sync_errors
from imocap_core.params import SyncParams
from imocap_core.params.sync_params import CycleMethod, Warp
from imocap_core.pipeline.runner import Display
from imocap_core.sync import SyncEvidence, SyncResult, synchronise
from imocap_core.sync.affinity import distance_matrix
from imocap_core.sync.cycle import relax, symmetric_affinity
from imocap_core.sync.maps import BlockMaps
from imocap_core.sync.reference import compared_pairs
from imocap_core.sync.warp.dtw import dtw, positions_of_rows
from imocap_core.sync.warp.soft_maps import Clocks
from imocap_core.sync.warp.template import median_positions
from imocap_core.workspace import Workspace

# Calibration of the confidence: the probability of a match within `sync.confidence_reach_s`.

EDGES = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0)


@dataclass(frozen=True)
class CalibrationRow:
    """Matched frames in a range of confidences: their number, mean confidence, the share within the
    reach, and the median error."""

    confidence: str
    frames: int
    mean_confidence: float
    within: float
    median_s: float


def confidences_and_errors(
    scene: SyncScene,
    reference: int,
    reference_frame: Sequence[Float[np.ndarray, " T"]],
    confidence: Sequence[Float[np.ndarray, " T"]],
) -> Float[np.ndarray, "n 2"]:
    """Confidence and error (seconds of the reference) of all matched frames that have a truth, the
    reference's frames left out."""
    reference_frames = np.arange(len(scene.phases[reference]), dtype=float)
    pairs = [np.zeros((0, 2))]
    for v, frames in enumerate(reference_frame):
        if v != reference:
            errors = sync_errors(
                frames, scene.phases[v], reference_frames, scene.phases[reference], scene.phase_end
            )
            both = errors.matched & errors.has_truth
            error_s = errors.frames[both] / scene.fps[reference]
            pairs.append(np.column_stack([confidence[v][both], error_s]))
    return np.concatenate(pairs)


def calibration(pairs: Float[np.ndarray, "n 2"], reach_s: float) -> list[CalibrationRow]:
    """One row for each range of confidences, and one for all; `pairs` as above."""
    rows = []
    ranges = [*pairwise(EDGES), (EDGES[0], EDGES[-1])]
    for low, high in ranges:
        # the last range includes its upper end
        inside = (pairs[:, 0] >= low) & ((pairs[:, 0] < high) | (high == EDGES[-1]))
        in_range = pairs[inside]
        if len(in_range):
            rows.append(
                CalibrationRow(
                    f"{low:.1f} to {high:.1f}",
                    len(in_range),
                    float(in_range[:, 0].mean()),
                    float(np.mean(in_range[:, 1] <= reach_s)),
                    float(np.median(in_range[:, 1])),
                )
            )
    return rows


# Rivals of the synchronisation: TCC on the same estimated poses, and clips stretched evenly.

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


# Errors of estimated correspondences of a scene of the sync benchmark.


@dataclass(frozen=True)
class SyncScore:
    """Means over the videos that are not the reference."""

    error_pct: float
    error_frames: float
    matched: float
    within_one: float  # share of matched frames within one frame of the reference
    confidence: float  # mean over matched frames


def score_maps(
    scene: SyncScene,
    reference: int,
    reference_frame: Sequence[Float[np.ndarray, " T"]],
    confidence: Sequence[Float[np.ndarray, " T"]] | None = None,
) -> SyncScore:
    """Score maps into the video `reference`: fractional frames of it for each video, NaN where
    unmatched."""
    reference_frames = np.arange(len(scene.phases[reference]), dtype=float)
    rows: list[list[float]] = []
    for v, estimate in enumerate(reference_frame):
        if v == reference:
            continue
        errors = sync_errors(
            estimate, scene.phases[v], reference_frames, scene.phases[reference], scene.phase_end
        )
        both = errors.matched & errors.has_truth
        mean_confidence = (
            float("nan")
            if confidence is None or not both.any()
            else float(confidence[v][both].mean())
        )
        near = float(np.mean(errors.frames[both] <= 1.0)) if both.any() else float("nan")
        rows.append(
            [
                sync_error_pct(errors),
                sync_error_frames(errors),
                matched_share(errors),
                near,
                mean_confidence,
            ]
        )
    return SyncScore(*(finite_mean(column) for column in zip(*rows, strict=True)))


def event_errors_frames(
    scene: SyncScene, reference: int, reference_frame: Sequence[Float[np.ndarray, " T"]]
) -> Float[np.ndarray, " others"]:
    """|a video's event mapped into the reference - the reference's event|, frames, per video other
    than the reference; infinite where the event is unmatched. ValueError for a scene without
    events."""
    if scene.events is None:
        raise ValueError(f"events: expected frames for {scene.name}, got none")
    event = scene.events[reference]
    errors = [
        abs(float(reference_frame[v][frame]) - event)
        for v, frame in enumerate(scene.events)
        if v != reference
    ]
    return np.nan_to_num(np.array(errors), nan=np.inf)


def pair_error_pct(scene: SyncScene, i: int, j: int, positions: Float[np.ndarray, " T"]) -> float:
    """Mean error of a map of video i into video j (fractional frames of it), in % of the motion."""
    frames_j = np.arange(len(scene.phases[j]), dtype=float)
    errors = sync_errors(positions, scene.phases[i], frames_j, scene.phases[j], scene.phase_end)
    return sync_error_pct(errors)


# Accuracy of the synchronisation alone, by method and warp, and its errors at events.
#
# Poses of the simulated estimator go straight into `synchronise`; no stage is run.

METHODS = ("none", "softmap", "als", "svt")
WARPS = ("posterior", "dtw")


@dataclass(frozen=True)
class AccuracyRow:
    """One clip: errors of the pairwise maps and of the maps to the reference, % of the motion."""

    clip: str
    warp: str
    method: str
    pairwise_pct: float
    sync_pct: float
    frames: float
    matched: float
    within_one_frame: float
    confidence: float


@dataclass(frozen=True)
class EventRow:
    """One action: |event - event of the reference| in frames, over its videos."""

    action: str
    median_frames: float
    largest_frames: float


def accuracy(
    folder: Path, sampling: str, settings: SyncParams, methods: Sequence[str], only: Sequence[str]
) -> list[AccuracyRow]:
    """Every clip with every method and warp (no loop), the rivals, and the means over the clips."""
    rows = []
    for file in sorted(folder.glob("*.npz")):
        if only and file.stem not in only:
            continue
        scene = protocol_scene(file, sampling)
        for warp in WARPS:
            rows += [_accuracy(scene, settings, warp, method) for method in methods]
        reference = _synchronised(scene, settings).reference
        rows += [_rival(scene, kind, reference) for kind in RIVALS]
    return rows + _means(rows)


def calibrated(
    folder: Path, sampling: str, settings: SyncParams, only: Sequence[str]
) -> list[CalibrationRow]:
    """The confidence of the frames of all clips against their errors, with the default settings."""
    pairs = []
    for file in sorted(folder.glob("*.npz")):
        if not only or file.stem in only:
            scene = protocol_scene(file, sampling)
            sync = _synchronised(scene, settings)
            pairs.append(
                confidences_and_errors(scene, sync.reference, sync.reference_frame, sync.confidence)
            )
    return calibration(np.concatenate(pairs), settings.confidence_reach_s) if pairs else []


def _accuracy(scene: SyncScene, settings: SyncParams, warp: str, method: str) -> AccuracyRow:
    choice = replace(settings, warp=cast(Warp, warp), method=cast(CycleMethod, method))
    sync = _synchronised(scene, choice)
    score = score_maps(scene, sync.reference, sync.reference_frame, sync.confidence)
    M = len(scene.poses)
    errors = []
    for i, j in ((i, j) for i in range(M) for j in range(M) if i != j):
        block = sync.relaxed.block(i, j)
        if warp == "dtw":
            positions = positions_of_rows(dtw(-block)[0], len(block))
        else:
            positions = median_positions(block)
        errors.append(pair_error_pct(scene, i, j, positions))
    return AccuracyRow(
        scene.name, warp, method, float(np.mean(errors)), score.error_pct, score.error_frames,
        score.matched, score.within_one, score.confidence,
    )  # fmt: skip


def _rival(scene: SyncScene, kind: str, reference: int) -> AccuracyRow:
    """A rival's maps to the reference; it has none between other videos."""
    frames, confidence = rival(kind, scene, reference)
    score = score_maps(scene, reference, frames, confidence)
    return AccuracyRow(
        scene.name, "-", kind, float("nan"), score.error_pct, score.error_frames,
        score.matched, score.within_one, score.confidence,
    )  # fmt: skip


def _synchronised(scene: SyncScene, settings: SyncParams) -> SyncResult:
    return synchronise(SyncEvidence(scene.poses, scene.fps), settings, np.random.default_rng(0))


def _means(rows: Sequence[AccuracyRow]) -> list[AccuracyRow]:
    """One row for each pair of warp and method: the mean over the clips."""
    means = []
    for warp, method in dict.fromkeys((r.warp, r.method) for r in rows):
        same = [list(asdict(r).values())[3:] for r in rows if (r.warp, r.method) == (warp, method)]
        means.append(AccuracyRow("mean", warp, method, *map(float, np.mean(same, axis=0))))
    return means


def events(folder: Path, settings: SyncParams, only: Sequence[str]) -> list[EventRow]:
    """Every action of the trials whose data give the frame of an event."""
    rows = []
    for file in sorted(folder.glob("*.npz")):
        if only and file.stem not in only:
            continue
        scene = trial_scene(file)
        if scene.events is None:
            continue
        sync = _synchronised(scene, settings)
        errors = event_errors_frames(scene, sync.reference, sync.reference_frame)
        rows.append(EventRow(scene.name, float(np.median(errors)), float(errors.max())))
    return rows


# Time and memory of each part of the synchronisation at several sizes.

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


# `imocap benchmark sync`: accuracy by method and warp, calibration, events, slow motion, freeze
# frames, speed.
#
# `--variants slow_motion`, `freeze_frames` and `calibration` measure one of these tables alone.

SLOW, FREEZE, CALIBRATION = "slow_motion", "freeze_frames", "calibration"
TABLES = (SLOW, FREEZE, CALIBRATION)
SEED = 8  # of the scenes; the weights of the confidence were fitted on scenes of smaller seeds


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The tables as Markdown, and where they were written."""
    variants, only, sampling = (
        options.variants or (*METHODS, *TABLES),
        options.only,
        options.sampling,
    )
    if unknown := set(variants) - {*METHODS, *TABLES}:
        names = ", ".join((*METHODS, *TABLES))
        raise WrongUse(f"--variants: expected some of {names}, got {unknown.pop()}")
    methods = [name for name in variants if name in METHODS]
    settings = workspace.pipeline().params.sync
    protocol, trials = (data_folder(workspace.root, kind) for kind in ("protocol", "trials"))
    tables: dict[str, Sequence[Any]] = {}
    if methods:
        tables |= {
            f"accuracy-{sampling}": accuracy(protocol, sampling, settings, methods, only),
            f"calibration-{sampling}": calibrated(protocol, sampling, settings, only),
            "events": events(trials, settings, only),
            "speed": speed(settings) if not only else [],
        }
    if SLOW in variants:
        tables["slow-motion"] = slow_motion(trials, settings, FACTORS, only)
    if FREEZE in variants:
        tables["freeze-frames"] = freeze_frames(trials, settings, only)
    if CALIBRATION in variants:
        train = data_folder(workspace.root, "train") / "cmu_train.npz"
        tables["calibration-training"] = reliability(train, settings, SEED)
    folder = workspace.root / "artifacts" / "benchmark" / "sync"
    parts = []
    for name, rows in tables.items():
        if rows:
            write_rows(folder, name, rows)
            parts += [f"## {name}", markdown_of_rows(rows)]
    return ["\n\n".join([*parts, f"Written to {folder}"])]

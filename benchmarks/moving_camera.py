"""Cameras that move from their place: told from tripods, and followed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import Float, UInt8
from rich.table import Table

from benchmarks.actions.walking_cameras import CENTRES, SIZE, WALKS, make_moving_yoga
from benchmarks.names import BenchmarkOptions
from benchmarks.parallel import ActionDisplay
from benchmarks.scoring import truth_of
from benchmarks.synthetic.moving_yoga import (
    CameraWalk,
    every_frame,
    make_moving_clip,
    moving_pictures,
)
from benchmarks.tables import cell, markdown_table, table_of_rows, write_rows, write_texts
from imocap_core.adapters.camera_motion import background_of
from imocap_core.adapters.relative_motion import Paths, paths_of, paths_of_initial
from imocap_core.alignment import rigid, similarity
from imocap_core.artifacts.schemas import CameraMotion, InitialSmpl, Keypoints, RefineSync
from imocap_core.body import load_free_body
from imocap_core.camera.camera_path import CameraPath
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.evaluate.action_scores import score_results
from imocap_core.evaluate.scoreboard import AFTER_LOOP, StageResult
from imocap_core.io.colmap import colmap_installed
from imocap_core.metrics.scoring import over_videos
from imocap_core.params import CameraMotionParams
from imocap_core.pipeline import runner
from imocap_core.pipeline.make_demo import demo_body
from imocap_core.pipeline.runner import Display
from imocap_core.synthetic.yoga_clip import YOGA_SPANS, DemoClip
from imocap_core.workspace import Workspace

# Small films of cameras that walk, turn, zoom or shake: is each told, and is its path followed?

STRIDE = 2  # of yoga's frames
KINDS = ("walks", "turns", "shakes", "zooms")
FIRST_SEED = 300  # of the films; defaults were chosen on others


@dataclass(frozen=True)
class FilmRow:
    """One film: what the test says, and how well a walk is followed.

    off_px: of a camera on one spot. extent_m: of the true path. path_mm: root mean square error
    after a similarity; focal_pct: error of the focal length. NaN where there is no path.
    """

    film: str
    kind: str
    verdict: str
    off_px: float
    extent_m: float
    path_mm: float
    focal_pct: float


def film_row(number: int) -> FilmRow:
    """Film `number`: of each kind in turn, in each of yoga's rooms in turn."""
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    kind, index, seed = KINDS[number % 4], (number // 4) % 4, FIRST_SEED + number
    rng = np.random.default_rng([seed, 9])
    shaped = demo_body(seed)
    clip = every_frame(make_moving_clip(seed, index, shaped, _walk(kind, rng), SIZE), STRIDE)
    frames = len(clip.xy_px)
    zoom = np.linspace(1.0, rng.uniform(1.3, 2.0), frames) if kind == "zooms" else None
    pictures = _gray(moving_pictures(clip, seed, index, shaped, zoom))
    background = background_of(
        pictures, _boxes(clip, zoom), clip.fps, SIZE, 1.0, CameraMotionParams()
    )
    test = background.parallax(None)
    path = None
    if test.moves:
        path = background.path(float(max(SIZE)), refine_focal=True)
    extent = float(np.ptp(clip.camera.centres, axis=0).max())
    error, focal = _errors(path, clip)
    return FilmRow(f"{seed} v{index + 1}", kind, test.verdict, test.off_px, extent, error, focal)


def film_count(videos: int) -> int:
    """Films of all kinds in all rooms, `videos` of each."""
    return len(KINDS) * len(YOGA_SPANS) * videos


def _walk(kind: str, rng: np.random.Generator) -> CameraWalk:
    if kind == "walks":
        sideways = float(rng.choice([-1, 1]) * rng.uniform(0.5, 2.0))
        return CameraWalk(sideways, float(rng.uniform(0.0, 0.4)), bend=float(rng.integers(2)))
    shake = {"turns": 1.5, "shakes": 3.0, "zooms": 0.7}[kind]
    return CameraWalk(0.0, shake_deg=shake, bob=False)


def _gray(pictures: Iterator[UInt8[np.ndarray, "H W 3"]]) -> Iterator[UInt8[np.ndarray, "H W"]]:
    for picture in pictures:
        yield np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), np.uint8)


def _boxes(clip: DemoClip, zoom: Float[np.ndarray, " T"] | None) -> Float[np.ndarray, "T 4"]:
    """Boxes around the true keypoints."""
    middle = clip.camera.K[:2, 2]
    grown = 1.0 if zoom is None else zoom[:, None, None]
    xy = middle + grown * (clip.xy_px - middle)
    return np.concatenate([xy.min(axis=1), xy.max(axis=1)], axis=1)


def _errors(path: CameraPath | None, clip: DemoClip) -> tuple[float, float]:
    if path is None:
        return float("nan"), float("nan")
    true = clip.camera.centres
    fit = similarity(path.centre, true)
    placed = fit.scale * path.centre @ fit.R_target_from_source.T + fit.t_target
    error = 1000 * float(np.sqrt(((placed - true) ** 2).sum(axis=1).mean()))
    return error, 100 * (path.focal_px / clip.camera.K[0, 0] - 1)


# Yoga with cameras that turn, that walk, and that walk along an unknown path: all through the
# pipeline, from given keypoints.

SEEDS = (31, 32)  # of performer, motion and cameras; defaults were chosen on others
METRICS = (
    "mpjpe_mm", "pa_mpjpe_mm", "w_mpjpe_mm", "root_path_error_mm", "foot_sliding_mm",
    "camera_rotation_error_deg", "reprojection_px",
)  # fmt: skip
CASES = ("turns", "one walks", "all walk", "all walk, paths unknown")
LAST = "refine_sync"
ONE = 0  # the video whose camera walks alone


@dataclass(frozen=True)
class MotionRow:
    """One action: its results after the loop, mean over its videos.

    path_mm: root mean square error of the metric paths, rigidly aligned, over the walking cameras;
    unit_pct: mean absolute error of their units; NaN without paths.
    """

    seed: int
    case: str
    numbers: dict[str, float]
    path_mm: float
    unit_pct: float


def motion_row(display: Display, root: Path, seed: int, case: str) -> MotionRow:
    """One action of a seed, made and run."""
    walks = {} if case == "turns" else {ONE: WALKS[ONE]} if case == "one walks" else dict(
        enumerate(WALKS)
    )  # fmt: skip
    folder = root / "artifacts" / "benchmark" / "moving_camera"
    name = f"yoga{seed}_{'_'.join(str(v) for v in sorted(walks)) or 'turns'}"
    action = folder / "actions" / name
    make_moving_yoga(action, seed, walks)
    sets = ["camera_motion.structure=false"] if case.endswith("unknown") else []
    shown = ActionDisplay(display, f"{name}, {case}")
    job = Workspace(folder).ready_job(str(action), sets, shown)
    done = {o.stage: o.stored for o in runner.run(job, shown, job.pipeline.upstream(LAST))}
    keypoints = done["keypoints"].decode(Keypoints)
    cameras, motion = done["camera_motion"].decode(CameraMotion), done[LAST].decode(RefineSync)
    solved = motion.motion
    result = StageResult(
        AFTER_LOOP, solved.videos, solved.cameras, motion.sync, paths_of(solved.cameras)
    )
    truth = truth_of(job, keypoints)
    rows = score_results([result], keypoints, cameras, truth, load_free_body())
    means = {row.metric: row.value for row in over_videos(rows)}
    paths = paths_of_initial(done["initial_smpl"].decode(InitialSmpl), cameras)
    error, unit = _path_errors(paths, action / CENTRES)
    return MotionRow(seed, case, {m: _number(means.get(m)) for m in METRICS}, error, unit)


def _number(value: float | None) -> float:
    return float("nan") if value is None else float(value)


def _path_errors(paths: Paths, centres: Path) -> tuple[float, float]:
    """Of the cameras whose path is known, by their true places."""
    errors, units = [], []
    with np.load(centres) as true:
        for video, path in paths.items():
            fit = rigid(path, true[video])
            off = path @ fit.R_target_from_source.T + fit.t_target - true[video]
            errors.append(1000 * float(np.sqrt((off**2).sum(axis=1).mean())))
            lengths = [float(np.linalg.norm(x - x.mean(axis=0))) for x in (path, true[video])]
            units.append(100 * abs(lengths[0] / lengths[1] - 1))
    return (float(np.mean(errors)), float(np.mean(units))) if errors else (np.nan, np.nan)


# The tables of `imocap benchmark moving_camera`.

WORDS = {
    "walks": "walks 0.5 to 2 m and turns",
    "turns": "turns on a tripod",
    "shakes": "turns and shakes on a spot",
    "zooms": "turns and zooms",
}


def markdown(films: Sequence[FilmRow], motions: Sequence[MotionRow]) -> str:
    """The parts that were measured."""
    parts = ([_films(films)] if films else []) + ([_motions(motions)] if motions else [])
    return "\n\n".join(parts) + "\n"


def _films(films: Sequence[FilmRow]) -> str:
    body = []
    for kind in KINDS:
        rows = [row for row in films if row.kind == kind]
        if not rows:
            continue
        moving = sum(row.verdict in ("found", "flat") for row in rows)
        untested = sum(row.verdict == "untested" for row in rows)
        paths = [row for row in rows if np.isfinite(row.path_mm)]
        body.append(
            [
                WORDS[kind],
                str(len(rows)),
                f"{moving} ({100 * moving / len(rows):.0f} %)",
                str(untested),
                cell(float(np.median([row.off_px for row in rows])), 2),
                *_paths(paths),
            ]
        )
    head = ["camera", "films", "called moving", "untested", "off a tripod (px)", "paths"]
    head += ["path error, median (mm)", "worst", "focal error, median (%)"]
    return markdown_table(head, body)


def _paths(rows: Sequence[FilmRow]) -> list[str]:
    if not rows:
        return ["–"] * 4
    errors = [row.path_mm for row in rows]
    focal = [abs(row.focal_pct) for row in rows]
    return [
        str(len(rows)),
        cell(float(np.median(errors)), 1),
        cell(max(errors), 1),
        cell(float(np.median(focal)), 1),
    ]


def _motions(motions: Sequence[MotionRow]) -> str:
    body = []
    for case in CASES:
        rows = [row for row in motions if row.case == case]
        if rows:
            means = [float(np.mean([row.numbers[m] for row in rows])) for m in METRICS]
            paths = [
                float(np.mean([getattr(row, f) for row in rows])) for f in ("path_mm", "unit_pct")
            ]
            body.append([case, str(len(rows)), *(cell(x, 1) for x in (*means, *paths))])
    head = ["cameras", "actions", *(m.removesuffix("_mm") for m in METRICS)]
    return markdown_table([*head, "path (mm)", "unit (%)"], body)


NAME, PARTS = "moving_camera", ("films", "motions")


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """Detection and paths on small films (`--only films`), motions through the pipeline
    (`--only motions`), or both; `--videos` films of each kind in each room."""
    for part in options.only:
        if part not in PARTS:
            raise WrongUse(f"--only {part}: expected one of {', '.join(PARTS)}")
    if not colmap_installed():
        raise WorkFailed("paths of cameras need COLMAP: pip install 'imocap[moving]'")
    folder = workspace.root / "artifacts" / "benchmark" / NAME
    films, motions = [], []
    if not options.only or "films" in options.only:
        count = film_count(options.videos)
        for number in range(count):
            display.progress(number / count, f"film {number + 1} of {count}")
            films.append(film_row(number))
        write_rows(folder, "films", films)
    if not options.only or "motions" in options.only:
        for seed, case in product(SEEDS, CASES):
            motions.append(motion_row(display, workspace.root, seed, case))
    text = markdown(films, motions)
    write_texts(folder, {"table.md": text})
    shown = [table_of_rows(films)] if films else []
    return [text, *shown, f"Written to {folder}"]

"""`imocap benchmark screening`: can the decisions about whole videos be relied on?"""

from __future__ import annotations

from pathlib import Path

from rich.table import Table

from benchmarks.actions.captured import data_folder
from benchmarks.names import BenchmarkOptions
from benchmarks.parallel import each
from benchmarks.screening.fits import STAGE, FittedCast, fitted_cast
from benchmarks.screening.measure import SceneRow, measure
from benchmarks.screening.scenes import CLIPS, ScreeningScene, scenes_of
from benchmarks.screening.tables import screening_table
from benchmarks.tables import write_rows
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.params import Params, SyncParams
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace

NAME = "screening"
DETECTOR = "mediapipe"


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The table of all scenes, and where it was written; `--only`: clips, all when empty."""
    if unknown := [clip for clip in options.only if clip not in CLIPS]:
        raise WrongUse(f"--only {unknown[0]}: expected one of {', '.join(CLIPS)}")
    folder = workspace.root / "artifacts" / "benchmark" / NAME
    scenes = scenes_of(_casts(options, workspace, folder, display))
    rows = _rows(scenes, workspace.pipeline().params.sync, options.jobs, display)
    if not rows:
        raise WrongUse("--only: expected clips of two subjects or more, as strangers to each other")
    text = screening_table(rows)
    write_rows(folder, "scenes", rows)
    (folder / "table.md").write_text(text, encoding="utf-8")
    return [text, f"Written to {folder}"]


def fit_clip(
    display: Display, data: Path, clip: str, params: Params, script: Path, cache: Path
) -> FittedCast:
    """One clip's cast."""
    display.progress(0.0, f"monocular fits of {clip}")
    return fitted_cast(data, clip, DETECTOR, params, script, cache)


def screen_scene(display: Display, scene: ScreeningScene, params: SyncParams) -> SceneRow:
    """One scene's row."""
    display.progress(0.0, f"scene {scene.name}")
    return measure(scene, params)


def _casts(
    options: BenchmarkOptions, workspace: Workspace, folder: Path, display: Display
) -> list[FittedCast]:
    data = data_folder(workspace.root, "train") / "cmu_train.npz"
    pipeline, cache = workspace.pipeline(), folder / "fits"
    params, script = pipeline.params, pipeline.script(STAGE)
    clips = [clip for clip in CLIPS if not options.only or clip in options.only]
    tasks = [(clip, (data, clip, params, script, cache)) for clip in clips]
    casts = {}
    for end in each(fit_clip, tasks, options.jobs, display):
        if end.result is None:
            raise WorkFailed(f"{end.name}: {end.fault}")
        casts[end.name] = end.result
    return [casts[clip] for clip in clips]


def _rows(
    scenes: list[ScreeningScene], params: SyncParams, jobs: int, display: Display
) -> list[SceneRow]:
    rows = {}
    tasks = [(scene.name, (scene, params)) for scene in scenes]
    for end in each(screen_scene, tasks, jobs, display):
        if end.result is None:
            raise WorkFailed(f"{end.name}: {end.fault}")
        rows[end.name] = end.result
    return [rows[scene.name] for scene in scenes]

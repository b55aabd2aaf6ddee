"""`imocap benchmark screening`: 100 made scenes with a stranger, a mirrored video, or neither."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks import screening_casts
from benchmarks.actions.captured_videos import data_folder, video_rng
from benchmarks.names import BenchmarkOptions
from benchmarks.parallel import each
from benchmarks.tables import markdown_table, write_rows
from imocap_core.adapters.hypotheses import keypoints_of_joints
from imocap_core.conventions import EVAL_14, SMPL_JOINTS, mirror_indices
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.params import Params, SyncParams
from imocap_core.pipeline.runner import Display
from imocap_core.sync import SyncEvidence, screened
from imocap_core.sync.screening.screening import Screening
from imocap_core.workspace import Workspace

# Scenes put together of casts: genuine videos alone, with a stranger, with a mirrored one.
#
# A stranger is a film of another cast, of another performer's repertoire; no walk is a stranger
# among walks. Whether a mirrored video can be recognised at all is measured on the true poses.

WALKS = ("02_01", "03_01", "05_01", "07_04", "12_01")
CLIPS = (
    *("05_08", "05_18", "07_04", "05_16", "06_08", "02_10", "05_20", "13_34", "02_05", "06_06"),
    *("05_02", "06_11", "05_09", "05_17", "01_01", "05_13", "05_15", "03_01", "13_33", "06_14"),
    *("05_10", "05_12", "13_30", "06_07", "06_09", "05_14", "13_09", "02_01", "05_04", "12_01"),
    *("05_07", "02_08", "13_07", "12_02", "13_08", "05_19", "13_10", "06_12", "02_04", "05_05"),
    *("05_03", "06_15", "02_09", "05_01", "06_10", "13_01", "13_15", "05_11", "05_06", "11_01"),
)  # in an order drawn once: every part of it has all kinds
SCENES_PER_CAST = screening_casts.MIRRORED_FILMS
VIDEOS = (3, 9)
TRUE_FILMS = 3  # of a cast, that tell whether its action is asymmetric


@dataclass(frozen=True)
class ScreeningScene:
    """Videos of one action, what replaces one of them, and the mirrored twin of another.

    development: whether margins were chosen on it. asymmetric: whether true poses tell the action
    from its mirror image.
    """

    name: str
    development: bool
    genuine: list[screening_casts.FittedFilm]
    replaced: int
    stranger: screening_casts.FittedFilm
    flipped: int
    mirrored: screening_casts.FittedFilm
    asymmetric: bool

    def with_stranger(self) -> list[screening_casts.FittedFilm]:
        """The videos, one of them replaced by one of another action."""
        return _replaced(self.genuine, self.replaced, self.stranger)

    def with_mirrored(self) -> list[screening_casts.FittedFilm]:
        """The videos, one of them mirrored."""
        return _replaced(self.genuine, self.flipped, self.mirrored)


def scenes_of(casts: Sequence[screening_casts.FittedCast]) -> list[ScreeningScene]:
    """Two scenes of every cast; every second cast is for development."""
    scenes = []
    for number, cast in enumerate(casts):
        asymmetric = is_asymmetric(cast)
        strangers = [other for other in casts if are_strangers(cast.clip, other.clip)]
        for variant in range(SCENES_PER_CAST if strangers else 0):
            rng = video_rng(f"scene {cast.clip}", variant, 0)
            scenes.append(_scene(cast, variant, strangers, rng, asymmetric, number % 2 == 0))
    return scenes


def are_strangers(clip: str, other: str) -> bool:
    """Whether two clips show different actions beyond doubt."""
    of_one_subject = clip.split("_")[0] == other.split("_")[0]
    return not of_one_subject and not (clip in WALKS and other in WALKS)


def is_asymmetric(cast: screening_casts.FittedCast) -> bool:
    """Whether true poses tell the action from its mirror image."""
    films = cast.films[:TRUE_FILMS]
    evidence = SyncEvidence(
        [film.true_joints_m for film in films],
        fps=[film.keypoints.fps for film in films],
        twins=mirror_indices(EVAL_14),
    )
    return not screened(evidence, Params().sync).symmetric


def _scene(
    cast: screening_casts.FittedCast,
    variant: int,
    strangers: Sequence[screening_casts.FittedCast],
    rng: np.random.Generator,
    asymmetric: bool,
    development: bool,
) -> ScreeningScene:
    count = int(rng.integers(VIDEOS[0], VIDEOS[1] + 1))
    rest = [v for v in range(screening_casts.FILMS) if v != variant]
    videos = [variant, *rng.choice(rest, count - 1, replace=False).tolist()]
    order = rng.permutation(count)
    chosen = [videos[k] for k in order]
    other = strangers[int(rng.integers(len(strangers)))]
    return ScreeningScene(
        name=f"{cast.clip} {'ab'[variant]}",
        development=development,
        genuine=[cast.films[v] for v in chosen],
        replaced=int(rng.integers(count)),
        stranger=other.films[int(rng.integers(len(other.films)))],
        flipped=chosen.index(variant),
        mirrored=cast.mirrored[variant],
        asymmetric=asymmetric,
    )


def _replaced(
    films: Sequence[screening_casts.FittedFilm], place: int, film: screening_casts.FittedFilm
) -> list[screening_casts.FittedFilm]:
    return [film if v == place else genuine for v, genuine in enumerate(films)]


# What the screening decides on every scene: clean, with a stranger, with a mirrored video.


@dataclass(frozen=True)
class SceneRow:
    """One scene. Videos as v1, v2, ... of the scene; - for none."""

    scene: str
    development: bool
    videos: int
    asymmetric: bool
    clean_excluded: int  # genuine videos, of the clean scene
    clean_flipped: int
    stranger: str
    stranger_excluded: str
    mirrored: str
    mirrored_flipped: str
    mirrored_excluded: str
    wrongly_treated: int  # genuine videos excluded or flipped, of all three
    near_symmetric_flips: int  # flipped though the action is not asymmetric, of all three


def measure(scene: ScreeningScene, params: SyncParams) -> SceneRow:
    """The row of a scene."""
    clean = screening_of(scene.genuine, params)
    stranger = screening_of(scene.with_stranger(), params)
    mirrored = screening_of(scene.with_mirrored(), params)
    wrong = [
        len({*clean.excluded, *clean.flipped}),
        len({*stranger.excluded, *stranger.flipped} - {scene.replaced}),
        len({*mirrored.excluded, *mirrored.flipped} - {scene.flipped}),
    ]
    flips = sum(len(result.flipped) for result in (clean, stranger, mirrored))
    return SceneRow(
        scene=scene.name,
        development=scene.development,
        videos=len(scene.genuine),
        asymmetric=scene.asymmetric,
        clean_excluded=len(clean.excluded),
        clean_flipped=len(clean.flipped),
        stranger=_named([scene.replaced]),
        stranger_excluded=_named(stranger.excluded),
        mirrored=_named([scene.flipped]),
        mirrored_flipped=_named(mirrored.flipped),
        mirrored_excluded=_named(mirrored.excluded),
        wrongly_treated=sum(wrong),
        near_symmetric_flips=0 if scene.asymmetric else flips,
    )


def screening_of(films: Sequence[screening_casts.FittedFilm], params: SyncParams) -> Screening:
    """The screening of videos, as the synchronisation does it."""
    detected = [(film.keypoints.confidence > 0).max(axis=1).astype(float) for film in films]
    evidence = SyncEvidence(
        [film.poses for film in films],
        fps=[film.keypoints.fps for film in films],
        confidence=[np.repeat(frames[:, None], 24, axis=1) for frames in detected],
        twins=mirror_indices(SMPL_JOINTS),
        keypoints=[keypoints_of_joints(film.keypoints) for film in films],
    )
    return screened(evidence, params)


def _named(videos: Sequence[int]) -> str:
    return " ".join(f"v{v + 1}" for v in sorted({*videos})) or "-"


# The table of `imocap benchmark screening`: shares over development, held-out and all scenes.

Counts = tuple[int, int]  # how many of how many


def screening_table(rows: Sequence[SceneRow]) -> str:
    """The counts as Markdown, one column for each half of the scenes and one for all."""
    halves = [
        [row for row in rows if row.development],
        [row for row in rows if not row.development],
        list(rows),
    ]
    body = [[what, *(_cell(count(half)) for half in halves)] for what, count in MEASURES.items()]
    return markdown_table(["", "development", "held out", "all"], body)


def genuine_treated(rows: Sequence[SceneRow]) -> Counts:
    """Genuine videos excluded or flipped, in all three variants of the scenes."""
    videos = sum(row.videos + 2 * (row.videos - 1) for row in rows)
    return sum(row.wrongly_treated for row in rows), videos


def clean_treated(rows: Sequence[SceneRow]) -> Counts:
    """The same, in clean scenes alone."""
    return sum(r.clean_excluded + r.clean_flipped for r in rows), sum(r.videos for r in rows)


def strangers_excluded(rows: Sequence[SceneRow]) -> Counts:
    """Strangers excluded."""
    return sum(row.stranger in row.stranger_excluded.split() for row in rows), len(rows)


def mirrored_flipped(rows: Sequence[SceneRow]) -> Counts:
    """Mirrored videos flipped, of asymmetric actions."""
    able = [row for row in rows if row.asymmetric]
    return sum(row.mirrored in row.mirrored_flipped.split() for row in able), len(able)


def near_symmetric_flipped(rows: Sequence[SceneRow]) -> Counts:
    """Videos of near-symmetric actions flipped, mirrored or not."""
    near = [row for row in rows if not row.asymmetric]
    flips = sum(row.near_symmetric_flips for row in near)
    return flips, sum(3 * row.videos for row in near)


def mirrored_excluded(rows: Sequence[SceneRow]) -> Counts:
    """Mirrored videos excluded as another action."""
    return sum(row.mirrored in row.mirrored_excluded.split() for row in rows), len(rows)


MEASURES: dict[str, Callable[[Sequence[SceneRow]], Counts]] = {
    "genuine videos excluded or flipped": genuine_treated,
    "of these in clean scenes": clean_treated,
    "strangers excluded": strangers_excluded,
    "mirrored videos of asymmetric actions flipped": mirrored_flipped,
    "mirrored videos excluded": mirrored_excluded,
    "videos of near-symmetric actions flipped": near_symmetric_flipped,
}


def _cell(counts: Counts) -> str:
    part, whole = counts
    return f"{part} of {whole} ({100 * part / whole:.1f} %)" if whole else "–"


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
) -> screening_casts.FittedCast:
    """One clip's cast."""
    display.progress(0.0, f"monocular fits of {clip}")
    return screening_casts.fitted_cast(data, clip, DETECTOR, params, script, cache)


def screen_scene(display: Display, scene: ScreeningScene, params: SyncParams) -> SceneRow:
    """One scene's row."""
    display.progress(0.0, f"scene {scene.name}")
    return measure(scene, params)


def _casts(
    options: BenchmarkOptions, workspace: Workspace, folder: Path, display: Display
) -> list[screening_casts.FittedCast]:
    data = data_folder(workspace.root, "train") / "cmu_train.npz"
    pipeline, cache = workspace.pipeline(), folder / "fits"
    params, script = pipeline.params, pipeline.script(screening_casts.STAGE)
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

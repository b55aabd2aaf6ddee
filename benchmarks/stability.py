"""`imocap benchmark stability`: whether harmless changes of an action move its result."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations, permutations
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks import tables
from benchmarks.actions.action_folder import ActionVariant, is_made
from benchmarks.actions.captured_videos import Choice, data_folder
from benchmarks.actions.prepare import existing_job, ready_job
from benchmarks.names import BenchmarkOptions
from benchmarks.parallel import ActionDisplay, LineDisplay, each, in_process, other_thread_count
from benchmarks.rendered_action import (
    RENDERED,
    RenderedChoice,
    check_detector,
    existing_rendered,
    is_rendered,
    ready_rendered,
    trial_of,
)
from benchmarks.scoring import LAST, ActionScore, cached_score, score_action, truth_of
from benchmarks.stability_variants import (
    OF_FILES,
    OF_PIXELS,
    Perturbation,
    make_variant,
    variant_key,
)
from imocap_core.artifacts.schemas import Camera, Keypoints, RefineSync, SyncSummary
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.io.truth import Truth
from imocap_core.metrics.sync import sync_error_frames, sync_errors
from imocap_core.metrics.trajectory import camera_rotation_error_deg
from imocap_core.pipeline.runner import Display, Job
from imocap_core.sync.axes import inverted
from imocap_core.workspace import Workspace

# Errors of cameras and correspondences over all pairs of videos, which no choice of a reference
# enters.

CAMERA_PAIRS, FRAME_PAIRS = "camera_pair_error_deg", "sync_pair_error_frames"


def pair_errors(
    cameras: Sequence[Camera], sync: SyncSummary, keypoints: Keypoints, truth: Truth
) -> dict[str, float]:
    """Means over all pairs of videos that are neither excluded nor mirrored; NaN for no pair."""
    apart = {*sync.excluded, *sync.mirrored}
    used = [video.id for video in keypoints.videos if video.id not in apart]
    angles = camera_pair_errors_deg([c for c in cameras if c.id in used], truth)
    frames = sync_pair_errors_frames(used, sync, keypoints, truth)
    return {CAMERA_PAIRS: tables.finite_mean(angles), FRAME_PAIRS: tables.finite_mean(frames)}


def camera_pair_errors_deg(cameras: Sequence[Camera], truth: Truth) -> list[float]:
    """Error of the rotation from one camera to another, of every pair whose true cameras are
    known."""
    true = {i: video.R for i, video in truth.videos.items() if video.R is not None}
    return [
        float(np.mean(camera_rotation_error_deg(a.R, b.R, true[a.id], true[b.id])))
        for a, b in combinations([c for c in cameras if c.id in true], 2)
    ]


def sync_pair_errors_frames(
    used: Sequence[str], sync: SyncSummary, keypoints: Keypoints, truth: Truth
) -> list[float]:
    """Mean error of each video's map into each other one, through the reference, in its frames."""
    phases = {i: v.phase for i, v in truth.videos.items() if v.phase is not None}
    videos = {video.id: video for video in keypoints.videos}
    maps = {sync_map.id: sync_map.reference_frame for sync_map in sync.maps}
    maps[sync.reference] = np.arange(float(len(maps[sync.reference])))
    errors = []
    with_truth = [i for i in used if i in phases and len(phases[i]) == len(maps[i])]
    for a, b in permutations(with_truth, 2):
        into = videos[b].frames
        matched = np.interp(inverted(maps[b], maps[a]), np.arange(len(into)), into)
        end = truth.phase_end or float(np.nanmax(phases[b]))
        of_pair = sync_errors(matched, phases[a], into, phases[b], end)
        errors.append(sync_error_frames(of_pair))
    return errors


# The undisturbed actions of the benchmark, and whether they can be run on this machine.

REAL, DEMO, TRIALS = "balance_beam", "yoga", ("cmu_walk_s07", "tennis_serve_jarua")
PIXELS = "-pixels"
FILMS = ("cmu_walk_s07", "cmu_forward_jump_s13", "tennis_serve_jarua")
ACTIONS = (REAL, REAL + PIXELS, DEMO, DEMO + PIXELS, *TRIALS, *(f + RENDERED for f in FILMS))


def is_detected(name: str) -> bool:
    """Whether an action of the benchmark starts from pixels."""
    return name.endswith(PIXELS) or is_rendered(name)


def perturbations_of(name: str) -> tuple[Perturbation, ...]:
    """What an action is put through; the first is the action as it is."""
    return OF_PIXELS if is_detected(name) else OF_FILES


def existing_source(workspace: Workspace, name: str) -> Path | None:
    """The folder of an undisturbed action, nothing made; None when there is none."""
    base = name.removesuffix(PIXELS)
    if base == REAL:
        try:
            return data_folder(workspace.root, REAL)
        except WorkFailed:
            return None
    if base == DEMO:
        folder = workspace.root / "actions" / DEMO
        return folder if folder.is_dir() else None
    try:
        if is_rendered(name):
            job = existing_rendered(workspace.root, RenderedChoice(), trial_of(name))
        else:
            job = existing_job(workspace, _trials(base), base, ())
    except WorkFailed:
        return None
    return None if job is None else job.action.folder


def ready_source(workspace: Workspace, name: str, display: Display) -> Path:
    """The folder of an undisturbed action, made first where the project makes it.

    WorkFailed with the reason when its data or the detector's environment are not here.
    """
    if is_detected(name):
        check_detector(workspace.root)
    base = name.removesuffix(PIXELS)
    if base == REAL:
        return data_folder(workspace.root, REAL)
    if is_rendered(name):
        shown = ActionDisplay(display, name)
        job = ready_rendered(workspace.root, RenderedChoice(), trial_of(name), shown)
        return job.action.folder
    choice = Choice(DEMO) if base == DEMO else _trials(base)
    return ready_job(workspace, choice, base, (), display).action.folder


def _trials(name: str) -> Choice:
    return Choice("trials", only=(name,))


# The tables of `imocap benchmark stability`: how far harmless perturbations move a result.

MPJPE, FRAMES = "mpjpe_mm", "sync_error_frames"
COLUMNS = (
    (MPJPE, 1, "MPJPE (mm)"),
    (tables.SCALED, 1, "scaled"),
    (tables.PA, 1, "P-MPJPE"),
    (CAMERA_PAIRS, 2, "cameras °"),
    (FRAME_PAIRS, 2, "sync, frames"),
    (tables.CAMERA, 2, "cameras to the reference °"),
    (FRAMES, 2, "sync to the reference, frames"),
)
LIMIT_PCT, LIMIT_DEG, LIMIT_FRAMES = 10.0, 1.0, 0.2


@dataclass(frozen=True)
class VariantScore:
    """The result of one perturbed action: metric -> mean over its videos, empty where it failed."""

    title: str
    numbers: dict[str, float]
    reference: str = ""
    excluded: tuple[str, ...] = ()
    mirrored: tuple[str, ...] = ()
    fault: str = ""

    def of(self, metric: str) -> float:
        """One number; NaN where it could not be scored."""
        return self.numbers.get(metric, math.nan)


@dataclass
class ActionStability:
    """Results of one action, first the undisturbed one. not_measured: why there are none."""

    name: str
    scores: list[VariantScore] = field(default_factory=list)
    not_measured: str = ""


@dataclass(frozen=True)
class Movement:
    """How far the results of one action lie apart.

    worst_pct: highest MPJPE over the median, in % of it. camera_deg, sync_frames: largest distance
    from the median. screening_differs: other videos are excluded or mirrored than undisturbed.
    """

    undisturbed_mm: float
    median_mm: float
    worst_mm: float
    worst_pct: float
    camera_deg: float
    sync_frames: float
    screening_differs: int
    faults: int

    @property
    def broken_limits(self) -> list[str]:
        """What keeps the action from being stable; a number that is missing keeps it too."""
        limits = (
            ("MPJPE", self.worst_pct, LIMIT_PCT),
            ("cameras", self.camera_deg, LIMIT_DEG),
            ("sync", self.sync_frames, LIMIT_FRAMES),
        )
        broken = [name for name, value, limit in limits if not value <= limit]
        return broken + ["a run failed"] * (self.faults > 0)


def movement(scores: Sequence[VariantScore]) -> Movement:
    """How far the results of one action's variants lie apart; the first is the undisturbed one."""
    mm = np.array([score.of(MPJPE) for score in scores if not score.fault])
    median = float(np.median(mm)) if len(mm) else math.nan
    worst = float(np.max(mm)) if len(mm) else math.nan
    screened = {(frozenset(s.excluded), frozenset(s.mirrored)) for s in scores[:1]}
    differing = [
        s for s in scores if (frozenset(s.excluded), frozenset(s.mirrored)) not in screened
    ]
    return Movement(
        scores[0].of(MPJPE),
        median,
        worst,
        100.0 * (worst / median - 1.0),
        _farthest(scores, CAMERA_PAIRS),
        _farthest(scores, FRAME_PAIRS),
        len([s for s in differing if not s.fault]),
        sum(bool(score.fault) for score in scores),
    )


def markdown(actions: Sequence[ActionStability]) -> str:
    """The whole report."""
    measured = [action for action in actions if action.scores]
    parts = [
        "# Stability: harmless perturbations",
        "Made by `imocap benchmark stability`. Every variant runs at the defaults; numbers are "
        "those after the loop, means over its videos. *worst* is the highest MPJPE, cameras and "
        "sync the largest distance from the median; their errors are means over all pairs of "
        "videos, as variants may differ in the reference. Limits: "
        f"{LIMIT_PCT:.0f} % of the median, "
        f"{LIMIT_DEG:.0f}°, {LIMIT_FRAMES:.1f} frames.",
        _movements(measured),
    ]
    missing = [action for action in actions if not action.scores]
    if missing:
        lines = [f"* {action.name}: {action.not_measured}" for action in missing]
        parts.append("**Not measured:**\n\n" + "\n".join(lines))
    parts.append(tables.DETAILS)
    for action in measured:
        parts += [f"## {action.name}", _variants(action.scores)]
    return "\n\n".join(parts) + "\n"


def _movements(actions: Sequence[ActionStability]) -> str:
    rows = []
    for action in actions:
        moved = movement(action.scores)
        values = (moved.undisturbed_mm, moved.median_mm, moved.worst_mm, moved.worst_pct)
        rows.append(
            [
                action.name,
                str(len(action.scores)),
                *(tables.cell(value, 1) for value in values),
                tables.cell(moved.camera_deg, 2),
                tables.cell(moved.sync_frames, 2),
                str(moved.screening_differs),
                "no: " + ", ".join(moved.broken_limits) if moved.broken_limits else "yes",
            ]
        )
    head = ["action", "runs", "undisturbed (mm)", "median", "worst", "over the median %"]
    return tables.markdown_table(
        [*head, "cameras °", "sync, frames", "other videos excluded or mirrored", "stable"], rows
    )


def _variants(scores: Sequence[VariantScore]) -> str:
    rows = [
        [
            f"{score.title}: {score.fault}" if score.fault else score.title,
            *(tables.cell(score.of(metric), digits) for metric, digits, _ in COLUMNS),
            score.reference,
            ", ".join(score.excluded) or "none",
            ", ".join(score.mirrored) or "none",
        ]
        for score in scores
    ]
    head = ["perturbation", *(heading for *_, heading in COLUMNS)]
    return tables.markdown_table([*head, "reference", "excluded", "mirrored"], rows)


def _farthest(scores: Sequence[VariantScore], metric: str) -> float:
    """Largest distance of a metric from its median; NaN where a run has no such number."""
    values = np.array([score.of(metric) for score in scores if not score.fault])
    return float(np.abs(values - np.median(values)).max()) if len(values) else math.nan


# Scores of every perturbed action, brought up to date.

NAME = "stability"


@dataclass(frozen=True)
class PerturbedAction(ActionVariant):
    """One perturbation of one action, below the benchmark's folder."""

    perturbation: Perturbation

    @property
    def variant(self) -> str:
        """The name of the perturbation."""
        return self.perturbation.name

    def job(self) -> Job:
        """Its job. Results are cached by their inputs, so that another number of threads needs a
        store of its own."""
        is_apart = self.perturbation.has_other_threads
        root = self.folder / self.perturbation.name if is_apart else self.folder
        return Workspace(root).job(str(self.action_folder), [])


def chosen_actions(only: tuple[str, ...]) -> list[str]:
    """The actions to run; WrongUse when `only` names one that does not exist."""
    unknown = [name for name in only if name not in ACTIONS]
    if unknown:
        raise WrongUse(f"--only {unknown[0]}: expected one of {', '.join(ACTIONS)}")
    return [name for name in ACTIONS if not only or name in only]


def measure(
    workspace: Workspace, only: tuple[str, ...], display: Display, jobs: int = 1
) -> tuple[str, Path]:
    """Run what is not finished and write the table after every variant; it and its folder.

    Actions not chosen are shown where their stored numbers are valid. An action whose data or
    detector are not here is named in the table. WorkFailed, after all others have run, when no
    chosen action can be run; a variant that fails is named in the table.
    """
    folder, chosen = workspace.root / "artifacts" / "benchmark" / NAME, chosen_actions(only)
    actions = {name: ActionStability(name) for name in ACTIONS}
    tasks = []
    for name in ACTIONS:
        variants = [PerturbedAction(folder, name, p) for p in perturbations_of(name)]
        if name not in chosen:
            actions[name] = _stored(workspace, name, variants)
            continue
        try:
            source = ready_source(workspace, name, display)
        except WorkFailed as fault:
            actions[name] = ActionStability(name, not_measured=str(fault))
            continue
        tasks += [(variant.name, (variant, source)) for variant in variants]
    if not tasks:
        raise WorkFailed("\n".join(f"{n}: {actions[n].not_measured}" for n in chosen))
    variant_of = {name: arguments[0] for name, arguments in tasks}
    for ended in each(one_variant, tasks, jobs, display):
        variant = variant_of[ended.name]
        title = variant.perturbation.title
        score = ended.result or VariantScore(title, {}, fault=ended.fault)
        actions[variant.action].scores.append(score)
        tables.write_texts(folder, {"table.md": markdown(_in_order(actions))})
    return markdown(_in_order(actions)), folder


def one_variant(display: Display, variant: PerturbedAction, source: Path) -> VariantScore:
    """Bring one variant up to date and score it."""
    if variant.perturbation.has_other_threads:
        return in_process(_scored, (LineDisplay(), variant, source), other_thread_count())
    return _scored(display, variant, source)


def _scored(display: Display, variant: PerturbedAction, source: Path) -> VariantScore:
    action_display = ActionDisplay(display, variant.name)
    detected = is_detected(variant.action)
    if not is_made(variant.action_folder, variant_key(source, variant.perturbation, detected)):
        action_display.started("perturb", [f"{variant.perturbation.title} is not made"])
        make_variant(variant.action_folder, source, variant.perturbation, detected)
    root = variant.job().store.folder.parent
    job = Workspace(root).ready_job(str(variant.action_folder), [], action_display)
    costs = variant.folder / "costs"
    score = score_action(job, action_display, variant.score_file, costs, with_oracle=False)
    return variant_score(variant.perturbation.title, job, score)


def _stored(workspace: Workspace, name: str, variants: list[PerturbedAction]) -> ActionStability:
    """An action's valid numbers, nothing run."""
    source = existing_source(workspace, name)
    action = ActionStability(name, not_measured="not run on this code")
    if source is None:
        return action
    for variant in variants:
        key = variant_key(source, variant.perturbation, is_detected(name))
        if variant.score_file.is_file() and is_made(variant.action_folder, key):
            job = variant.job()
            score = cached_score(job, variant.score_file)
            if score is not None:
                action.scores.append(variant_score(variant.perturbation.title, job, score))
    return action


def variant_score(title: str, job: Job, score: ActionScore) -> VariantScore:
    """The result of a scored action: means over its videos, and errors over all pairs of them."""
    stored = [job.store.load(job.action.name, stage) for stage in ("keypoints", LAST)]
    assert stored[0] is not None, "a scored action has its artifacts"
    assert stored[1] is not None
    keypoints, refined = stored[0].decode(Keypoints), stored[1].decode(RefineSync)
    sync, truth = refined.sync, truth_of(job, keypoints)
    pairs = pair_errors(refined.motion.cameras, sync, keypoints, truth)
    return VariantScore(
        title,
        score.numbers["after loop"] | pairs,
        sync.reference,
        tuple(sync.excluded),
        tuple(sync.mirrored),
    )


def _in_order(actions: dict[str, ActionStability]) -> list[ActionStability]:
    """Actions in the order of ACTIONS, each one's variants in the order of its perturbations."""
    for name, action in actions.items():
        titles = [perturbation.title for perturbation in perturbations_of(name)]
        action.scores.sort(key=lambda score: titles.index(score.title))
    return [actions[name] for name in ACTIONS]


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The tables as Markdown, and what was written."""
    text, folder = measure(workspace, options.only, display, options.jobs)
    return [text, f"Written to {folder}"]

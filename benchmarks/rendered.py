"""`imocap benchmark rendered`: from pixels to motion with a real detector."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks.detection_errors import DetectedClip, PointErrors, point_errors, swapped_share
from benchmarks.names import BenchmarkOptions
from benchmarks.parallel import ActionDisplay, each
from benchmarks.rendered_action import (
    LAYOUT,
    POINTS,
    RenderedChoice,
    existing_rendered,
    ready_rendered,
    rendered_names,
)
from benchmarks.scoring import RESULTS, ActionScore, cached_score, cost_sentence, score_action
from benchmarks.tables import (
    ALL_JOINTS,
    CAMERA,
    DETAILS,
    PA,
    SCALED,
    SYNC,
    cell,
    finite_mean,
    finite_median,
    gap_closed,
    markdown_table,
    mean_cell,
    missing_sentence,
)
from imocap_core.detect.detectors import detector_of
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.evaluate.scoreboard import true_joints
from imocap_core.io.readers.estimates import PerformerBoxes
from imocap_core.io.readers.mediapipe import read_mediapipe, read_mediapipe_world
from imocap_core.io.truth import read_truth
from imocap_core.io.video import probe
from imocap_core.metrics.scoring import CameraJoints, over_videos, pose_rows
from imocap_core.params import DetectParams
from imocap_core.pipeline.runner import Display, Job
from imocap_core.workspace import Workspace

# Detections of rendered videos beside their true points, and errors of the detector's own 3D.


def detected_clips(job: Job) -> tuple[list[DetectedClip], tuple[str, ...]]:
    """Detections of the action's videos, and the names of their points; all must be detected."""
    clips = []
    names: tuple[str, ...] = ()
    least = job.settings.params.keypoints.min_confidence
    with np.load(job.action.folder / POINTS) as stored:
        for video in job.action.videos:
            assert video.video is not None
            info = probe(job.action.folder / video.video)
            detections = read_mediapipe(job.action.detected[video.id], LAYOUT, info.size)
            true, columns = stored[f"{video.id}/xy_px"], stored[f"{video.id}/columns"]
            names = tuple(str(name) for name in stored[f"{video.id}/names"])
            xy_px, used = np.full(true.shape, np.nan), np.zeros(true.shape[:2], dtype=bool)
            for frame, people in zip(detections.frames.tolist(), detections.people, strict=True):
                if len(people) and frame < len(true):
                    xy_px[frame] = people[0][columns, :2]
                    used[frame] = people[0][columns, 2] >= least
            height, side = stored[f"{video.id}/height_px"], str(stored[f"{video.id}/side"])
            clips.append(DetectedClip(xy_px, true, height, side, info.fps, used))
    return clips, names


def detector_3d_errors(job: Job) -> dict[str, float]:
    """Errors of the detector's own 3D landmarks: metric -> mean over the videos."""
    assert job.action.truth is not None
    rows = []
    infos = {v.id: probe(job.action.folder / str(v.video)) for v in job.action.videos}
    used = {name: np.arange(info.frame_count) for name, info in infos.items()}
    truth = read_truth(job.action.folder / job.action.truth, used)
    for name, info in infos.items():
        true = true_joints(truth.videos[name], used[name])
        if true is None:
            continue
        everywhere = np.tile([0.0, 0.0, *info.size], (len(used[name]), 1))
        boxes = PerformerBoxes(used[name], everywhere, info.size)
        landmarks = read_mediapipe_world(job.action.detected[name], boxes)
        motion = CameraJoints(landmarks.joints, landmarks.joint_names, used[name])
        rows += pose_rows("estimator", name, motion, true, info.fps)
    return {row.metric: row.value for row in over_videos(rows) if row.value is not None}


# The tables of `imocap benchmark rendered`: errors of the motion, and of the detector.

BODY = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
SIDES = ("front", "side", "back")
Value = Callable[[ActionScore], float | None]


def markdown(
    scores: Sequence[ActionScore],
    films: Sequence[DetectedClip],
    names: Sequence[str],
    missing: Sequence[str],
    command: str,
) -> str:
    """The whole report."""
    errors = point_errors(films, names)
    parts = [
        "# From pixels: captured performances rendered, detected by a real detector",
        f"Made by `{command}`: performances of `trials` on the free body, each in its own scene "
        f"and before its own camera, detected by {detector_name()}. "
        f"{cost_sentence([s.costs for s in scores])} `estimator` is the detector's 3D alone."
        + missing_sentence(missing),
        motion_table(scores),
        DETAILS,
        "## The detector's errors",
        f"{len(films)} films, {sum(len(f.true_px) for f in films)} frames. Lengths are hundredths "
        "of the person's standing height in the picture (1.7 cm on a person of 1.7 m). `spread`: "
        "per axis, about the mean of the film, without outliers. `lasts`: share and time constant "
        "of what persists. An outlier is further than 5 spreads from the middle of its point; "
        "hidden limbs are guessed, with a confidence that mostly is too low to be used.",
        points_table(errors),
        sides_table(films, names),
        "## What the simulated detector would need",
        proposal(films, errors, names),
    ]
    return "\n\n".join(parts) + "\n"


def detector_name() -> str:
    """The detector of `keypoints: detect` that nobody chose another for, with its version."""
    return detector_of(DetectParams(), Path()).version


def motion_table(scores: Sequence[ActionScore]) -> str:
    """One row for each action, and their mean."""
    columns: list[tuple[str, int, Value]] = [
        *((result, 1, _of(result, SCALED)) for result in RESULTS),
        ("gap closed %", 0, _gap),
        ("P-MPJPE, after loop", 1, _of("after loop", PA)),
        ("24 joints, not scaled, after loop", 1, _of("after loop", ALL_JOINTS)),
        ("sync %", 2, _of("after loop", SYNC)),
        ("cameras °", 1, _of("after loop", CAMERA)),
    ]
    rows = [
        [s.action, str(s.videos), str(s.frames), *(cell(of(s), n) for _, n, of in columns)]
        for s in scores
    ]
    means = [
        mean_cell([value for s in scores if (value := of(s)) is not None], digits)
        for _, digits, of in columns
    ]
    rows.append(["**mean**", "", "", *means])
    return "MPJPE, scaled, mm on 12 joints, unless the column says otherwise.\n\n" + markdown_table(
        ["action", "videos", "frames", *(name for name, _, _ in columns)], rows
    )


def points_table(errors: Sequence[PointErrors]) -> str:
    """One row for each point."""
    rows = [
        [
            p.point,
            f"{100 * p.bias_x:+.2f}, {100 * p.bias_y:+.2f}",
            f"{100 * p.spread:.2f}",
            f"{cell(p.persistent, 2)}, {cell(p.persistence_s, 2)} s",
            f"{100 * p.outlier_rate:.1f}",
            f"{100 * p.outlier_size:.1f}",
            f"{100 * p.unused_rate:.1f}",
            f"{100 * p.used_outlier_rate:.1f}",
            f"{100 * p.miss_rate:.1f}",
        ]
        for p in errors
    ]
    head = ["point", "bias x, y", "spread", "lasts", "outliers %", "their size"]
    head += ["not used %", "outliers of those used %", "missed %"]
    return markdown_table(head, rows)


def sides_table(films: Sequence[DetectedClip], names: Sequence[str]) -> str:
    """One row for each side of view: all body points together."""
    body = _body(names)
    rows = []
    for side in SIDES:
        of_side = [film for film in films if film.side == side]
        if not of_side:
            continue
        errors = np.concatenate(
            [np.linalg.norm(f.error[:, body], axis=-1).ravel() for f in of_side]
        )
        errors = errors[np.isfinite(errors)]
        swapped = [
            finite_mean([swapped_share(f, names, p) for f in of_side]) for p in ("arm", "leg")
        ]
        rows.append(
            [
                side,
                str(len(of_side)),
                *(f"{100 * np.quantile(errors, q):.2f}" for q in (0.5, 0.9)),
                *(cell(100 * share, 1) for share in swapped),
            ]
        )
    head = ["seen from", "films", "median error", "90 % below", "arms swapped %"]
    return markdown_table([*head, "legs swapped %"], rows)


def proposal(
    films: Sequence[DetectedClip], errors: Sequence[PointErrors], names: Sequence[str]
) -> str:
    """Parameters of imocap_core/synthetic/detector.py that agree with the measured errors."""
    body = [errors[k] for k in _body(names)]
    swaps = [swapped_share(film, names, part) for film in films for part in ("arm", "leg")]
    values = [
        ("noise", float(np.sqrt(finite_mean([p.spread**2 for p in body]))), 4),
        ("persistent share (0.5 in the code)", finite_median([p.persistent for p in body]), 2),
        ("persistence_s", finite_median([p.persistence_s for p in body]), 2),
        ("outlier_rate", finite_mean([p.outlier_rate for p in body]), 3),
        ("outlier_noise", finite_median([p.outlier_size for p in body if p.outlier_size > 0]), 3),
        ("miss_rate", finite_mean([p.miss_rate for p in body]), 3),
        ("swap_rate", finite_mean(swaps), 3),
        ("bias (root mean square; not modelled)", _bias(body), 4),
    ]
    rows = [[name, cell(value, digits)] for name, value, digits in values]
    return (
        "Over shoulders, elbows, wrists, hips, knees and ankles; a proposal, not in force.\n\n"
        + markdown_table(["DetectorErrors", "measured"], rows)
    )


def _of(result: str, metric: str) -> Value:
    return lambda score: score.of(result, metric)


def _gap(score: ActionScore) -> float | None:
    gap = gap_closed(*(score.of(r, SCALED) for r in ("monocular", "after loop", "oracle")))
    return gap if np.isfinite(gap) else None


def _body(names: Sequence[str]) -> list[int]:
    return [k for k, name in enumerate(names) if name.split("_", 1)[-1] in BODY]


def _bias(body: Sequence[PointErrors]) -> float:
    return float(np.sqrt(finite_mean([(p.bias_x**2 + p.bias_y**2) / 2 for p in body])))


# Scores of rendered actions, brought up to date, and their table.


def measure(
    workspace: Workspace, choice: RenderedChoice, display: Display, jobs: int = 1
) -> tuple[str, Path]:
    """Run what is not finished and write the tables after every action; them and their folder.

    An interrupted run goes on where it stopped: videos, detections, stages and numbers are stored.
    WorkFailed, after all others have run, when an action failed.
    """
    folder, root = choice.folder(workspace.root), workspace.root
    every = rendered_names(root)
    unknown = [name for name in choice.only if name not in every]
    if unknown:
        raise WrongUse(f"--only {unknown[0]}: expected one of {', '.join(every)}")
    chosen = [name for name in every if not choice.only or name in choice.only]
    done = {n: s for n in every if n not in chosen and (s := _cached(root, choice, n))}
    faults = []
    text = ""
    for ended in each(one_action, [(n, (root, choice, n)) for n in chosen], jobs, display):
        if ended.result is None:
            faults.append(f"{ended.name}: {ended.fault}")
            continue
        done[ended.name] = ended.result
        text = _written(root, choice, every, done)
    if faults:
        raise WorkFailed("\n".join(faults))
    return text, folder


def one_action(display: Display, root: Path, choice: RenderedChoice, name: str) -> ActionScore:
    """Bring one action up to date and score it."""
    action_display = ActionDisplay(display, name)
    job = ready_rendered(root, choice, name, action_display)
    costs = choice.folder(root) / "costs"
    return score_action(job, action_display, _score_path(root, choice, name), costs)


def _written(
    root: Path, choice: RenderedChoice, every: list[str], done: dict[str, ActionScore]
) -> str:
    """Write the report of the actions that are done; its text."""
    scores, films = [], []
    names: tuple[str, ...] = ()
    for name in (n for n in every if n in done):
        job = existing_rendered(root, choice, name)
        assert job is not None, "its score is of the action as it is"
        of_action, names = detected_clips(job)
        films += of_action
        numbers = {"estimator": detector_3d_errors(job), **done[name].numbers}
        scores.append(replace(done[name], numbers=numbers))
    missing = [name for name in every if name not in done]
    text = markdown(scores, films, names, missing, choice.command)
    (choice.folder(root) / "table.md").write_text(text, encoding="utf-8")
    return text


def _cached(root: Path, choice: RenderedChoice, name: str) -> ActionScore | None:
    """Stored numbers of an action that is not run now; None when anything of it has changed."""
    file, job = _score_path(root, choice, name), existing_rendered(root, choice, name)
    return cached_score(job, file) if job is not None and file.is_file() else None


def _score_path(root: Path, choice: RenderedChoice, name: str) -> Path:
    return choice.folder(root) / "scores" / f"{name}.json"


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The tables as Markdown, and what was written."""
    choice = RenderedChoice(options.videos, options.small, options.only)
    text, folder = measure(workspace, choice, display, options.jobs)
    return [text, f"Written to {folder}"]

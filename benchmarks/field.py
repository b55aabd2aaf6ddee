"""Real clips of exercises and throws, scored by what a person sees in them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from jaxtyping import Float
from rich.table import Table

from benchmarks.actions.captured_videos import data_base
from benchmarks.names import BenchmarkOptions
from benchmarks.parallel import ActionDisplay, each
from benchmarks.scoring import SetErrors, run_to_prediction, set_errors
from benchmarks.tables import DETAILS, cell, markdown_table, write_texts
from imocap_core.artifacts.schemas import CameraMotion, InitialSmpl, RefineSync
from imocap_core.artifacts.store import Stored
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.pipeline.runner import Display
from imocap_core.report.tables import ground_tables
from imocap_core.result.artifacts import artifacts_of_stages
from imocap_core.result.read import read_result
from imocap_core.result.result import ActionResult
from imocap_core.result.video import VideoResult
from imocap_core.workspace import Workspace

# What a person sees in a clip, as ranges of quantities of the result.
#
# Frames are source frame numbers, both ends within. A fact without frames is one number a video.

Ground = Mapping[str, Mapping[str, float]]  # video -> column of the ground's table -> value
Curve = Float[np.ndarray, " T"]
STATISTICS: dict[str, Callable[[Curve], float]] = {
    "min": lambda x: float(np.min(x)),
    "max": lambda x: float(np.max(x)),
    "median": lambda x: float(np.median(x)),
}
SIDES = ("left", "right")
NO_FACTS: Mapping[str, Any] = {}


@dataclass(frozen=True)
class CheckedFact:
    """A fact, what the result has instead, and whether that is within the fact's range."""

    name: str
    value: float
    right: bool


def check_facts(
    truth: Mapping[str, Any], result: ActionResult, ground: Ground, treated: Mapping[str, str]
) -> list[CheckedFact]:
    """Every fact of a set: which videos are treated how, the synchronisation, and measures.

    Args:
        truth: the set's entry of `truth.yaml`. treated: of videos that are excluded or mirrored.
    """
    facts = []
    if "treated" in truth:
        wrong = {
            v for v in {*treated, *truth["treated"]} if treated.get(v) != truth["treated"].get(v)
        }
        facts.append(CheckedFact("treated", float(len(wrong)), not wrong))
    errors = sync_errors_frames(truth, result)
    if len(errors):
        mean = float(np.nanmean(errors))
        facts.append(CheckedFact("sync", mean, mean <= truth.get("sync_within", 1)))
    for fact in truth.get("facts", ()):
        low, high = fact["range"]
        value = fact_value(fact, result, ground)
        facts.append(CheckedFact(fact["measure"], value, low <= value <= high))
    return facts


def fact_value(fact: Mapping[str, Any], result: ActionResult, ground: Ground) -> float:
    """The measured quantity, by the fact's statistic over its frames."""
    measure, video = fact["measure"], str(fact.get("video"))
    if measure in ("roll_deg", "pitch_down_deg", "sole_depth_mm"):
        return ground[video][measure]
    if measure == "camera_yaw_apart_deg":
        return camera_yaw_apart_deg(result)
    if measure == "trunk_from_horizontal_deg":
        result = result.levelled("y")
    curve = CURVES[measure](result[video])
    first, last = fact["frames"]
    frames = np.floor(np.asarray(result[video].frames))
    return STATISTICS[fact.get("stat", "median")](curve[(frames >= first) & (frames <= last)])


def sync_errors_frames(truth: Mapping[str, Any], result: ActionResult) -> Curve:
    """Errors of matches with the reference at marked events, or of all under a known offset.

    Events that recur in no fixed order (`cyclic_events`) match the nearest of the reference's.
    """
    reference, errors = result.reference, list[float]()
    others = [v for v in result.ids if v != reference]
    matched = {v: _matched_frame(result, v) for v in others}
    for events in truth.get("events", NO_FACTS).values():
        right = np.atleast_1d(events.get(reference, []))
        for v in others:
            ours = np.atleast_1d(events.get(v, []))[: len(right)]
            errors += [abs(matched[v](f) - g) for f, g in zip(ours, right, strict=False)]
    if "offset" in truth:
        offset = truth["offset"]
        for v in others:
            frames, to_reference = _matches(result, v)
            errors += np.abs(to_reference - frames - offset[v] + offset[reference]).tolist()
    for events in truth.get("cyclic_events", NO_FACTS).values():
        right = np.atleast_1d(events.get(reference, []))
        for v in others if len(right) else ():
            position = np.array([matched[v](f) for f in np.atleast_1d(events.get(v, []))])
            position = position[
                (position >= right[0] - CYCLE_MARGIN) & (position <= right[-1] + CYCLE_MARGIN)
            ]
            errors += np.abs(position[:, None] - right).min(axis=1).tolist()
    return np.array(errors)


CYCLE_MARGIN = 8  # frames before the reference's first and after its last event that are compared


def _matches(result: ActionResult, video: str) -> tuple[Curve, Curve]:
    """Frames of a video that are matched, and the reference's frames at these moments."""
    matches = result.sync.matches(video, result.reference)
    frames = np.asarray(result[video].frames, dtype=float)
    finite = np.isfinite(matches.frame)
    return frames[finite], matches.frame[finite]


def _matched_frame(result: ActionResult, video: str) -> Callable[[float], float]:
    """The reference's frame at a frame of a video; NaN where no frame is matched."""
    frames, to_reference = _matches(result, video)
    if not len(frames):
        return lambda _: float("nan")
    return lambda frame: float(np.interp(frame, frames, to_reference))


def camera_yaw_apart_deg(result: ActionResult) -> float:
    """Angle between the first two cameras' lines of sight, seen from above."""
    level = result.levelled("y")
    ahead = [level[v].camera.R[2] for v in result.ids[:2]]
    first, second = (np.degrees(np.arctan2(a[0], a[2])) for a in ahead)
    return float(abs((first - second + 180) % 360 - 180))


def knee_flexion_deg(video: VideoResult) -> Curve:
    """Of the leg that is bent more; 0 is straight."""
    bent = []
    for side in SIDES:
        thigh = _unit(_joint(video, f"{side}_hip") - _joint(video, f"{side}_knee"))
        shank = _unit(_joint(video, f"{side}_ankle") - _joint(video, f"{side}_knee"))
        bent.append(180 - np.degrees(np.arccos(np.clip((thigh * shank).sum(-1), -1, 1))))
    return np.max(bent, axis=0)


def knees_ahead_m(video: VideoResult) -> Curve:
    """How much nearer to the camera the knees are than the hips, in the mean of both legs."""
    depth = {
        name: (_joint(video, name) @ video.camera.R.T + video.camera.t)[:, 2]
        for name in (f"{side}_{joint}" for side in SIDES for joint in ("hip", "knee"))
    }
    ahead = [depth[f"{side}_hip"] - depth[f"{side}_knee"] for side in SIDES]
    return np.asarray(np.mean(ahead, axis=0))


def trunk_from_horizontal_deg(video: VideoResult) -> Curve:
    """Elevation of the line from pelvis to neck, in a world with y up."""
    trunk = _unit(_joint(video, "neck") - _joint(video, "pelvis"))
    return np.asarray(np.abs(np.degrees(np.arcsin(np.clip(trunk[:, 1], -1, 1)))))


def wrists_to_head_mm(video: VideoResult) -> Curve:
    """Distance of the farther wrist from the head."""
    away = [_joint(video, f"{side}_wrist") - _joint(video, "head") for side in SIDES]
    return 1000 * np.linalg.norm(away, axis=-1).max(axis=0)


def wrists_apart_mm(video: VideoResult) -> Curve:
    """Distance between the wrists."""
    apart = _joint(video, "left_wrist") - _joint(video, "right_wrist")
    return np.asarray(1000 * np.linalg.norm(apart, axis=-1))


def right_wrist_ahead_m(video: VideoResult) -> Curve:
    """How far the right wrist is in front of the chest."""
    across = _joint(video, "left_shoulder") - _joint(video, "right_shoulder")
    front = _unit(np.cross(across, _joint(video, "neck") - _joint(video, "pelvis")))
    reach = _joint(video, "right_wrist") - _joint(video, "spine3")
    return np.asarray((reach * front).sum(-1))


def right_wrist_speed_m_s(video: VideoResult) -> Curve:
    """Speed between each frame and the one before; 0 in the first."""
    steps = np.diff(_joint(video, "right_wrist"), axis=0)
    return np.concatenate([[0.0], np.linalg.norm(steps, axis=-1) * video.fps])


CURVES: dict[str, Callable[[VideoResult], Curve]] = {
    f.__name__: f
    for f in (
        knee_flexion_deg,
        knees_ahead_m,
        trunk_from_horizontal_deg,
        wrists_to_head_mm,
        wrists_apart_mm,
        right_wrist_ahead_m,
        right_wrist_speed_m_s,
    )
}


def _joint(video: VideoResult, name: str) -> Float[np.ndarray, "T 3"]:
    return np.asarray(video.joints[:, list(video.joint_names).index(name)])


def _unit(x: Float[np.ndarray, "T 3"]) -> Float[np.ndarray, "T 3"]:
    return np.asarray(x / np.linalg.norm(x, axis=-1, keepdims=True))


# Every set of real clips at the user's defaults: facts that are right, leave-one-out errors.


@dataclass(frozen=True)
class FieldSet:
    """One set: its facts, and the errors of its videos."""

    name: str
    facts: list[CheckedFact]
    errors: SetErrors


def field_truth(root: Path) -> tuple[Path, dict[str, Any]]:
    """The folder of the sets, and what is true of each. WorkFailed when it is not there."""
    folder = data_base(root) / "field"
    file = folder / "truth.yaml"
    if not file.is_file():
        raise WorkFailed(f"{file}: there is no such file; IMOCAP_DATA names the folder of field/")
    truth = yaml.safe_load(file.read_text(encoding="utf-8"))
    return folder, {name: facts for name, facts in truth.items() if (folder / name).is_dir()}


def chosen_sets(truth: Mapping[str, Any], only: tuple[str, ...]) -> list[str]:
    """The sets to run; WrongUse when one does not exist."""
    for name in only:
        if name not in truth:
            raise WrongUse(f"--only {name}: expected one of {', '.join(truth)}")
    return [name for name in truth if not only or name in only]


def measure_set(display: Display, root: Path, name: str) -> FieldSet:
    """One set at the defaults."""
    folder, truth = field_truth(root)
    shown = ActionDisplay(display, name)
    workspace = Workspace(root / "artifacts" / "benchmark" / "field")
    job = workspace.ready_job(str(folder / name), [], shown)
    done = run_to_prediction(job, shown)
    return FieldSet(name, facts_of(truth[name], name, done), set_errors(done))


def facts_of(truth: Mapping[str, Any], name: str, done: Mapping[str, Stored]) -> list[CheckedFact]:
    """The facts of a run's artifacts."""
    result = read_result(artifacts_of_stages(name, done), ActionResult)
    refined = done["refine_sync"].decode(RefineSync)
    tables = ground_tables(
        done["initial_smpl"].decode(InitialSmpl),
        done["camera_motion"].decode(CameraMotion),
        refined,
    )
    ground = {
        str(row[0]): {
            c: float(x) for c, x in zip(t.columns[1:5], row[1:5], strict=True) if x is not None
        }
        for t in tables
        for row in t.rows
    }
    treated = dict.fromkeys(refined.sync.mirrored, "mirrored")
    treated |= dict.fromkeys(refined.sync.excluded, "excluded")
    return check_facts(truth, result, ground, treated)


HEAD = ("set", "right", "of", "left out, % of height", "within 10 %", "monocular, %", "wrong")


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The tables as Markdown, and where they were written."""
    _, truth = field_truth(workspace.root)
    tasks = [(name, (workspace.root, name)) for name in chosen_sets(truth, options.only)]
    sets, faults = list[FieldSet](), list[str]()
    for end in each(measure_set, tasks, options.jobs, display):
        if end.result is None:
            faults.append(f"{end.name}: {end.fault}")
        else:
            sets.append(end.result)
    folder = workspace.root / "artifacts" / "benchmark" / "field"
    text = markdown(sets)
    write_texts(folder, {"table.md": text})
    return [text, *faults, f"Written to {folder}"]


def markdown(sets: Sequence[FieldSet]) -> str:
    """A row a set, and how often each measure is right."""
    rows = [
        [
            s.name,
            str(sum(f.right for f in s.facts)),
            str(len(s.facts)),
            cell(s.errors.error_pct, 2),
            cell(s.errors.share_10, 2),
            cell(s.errors.monocular_pct, 2),
            ", ".join(f"{f.name} {f.value:.4g}" for f in s.facts if not f.right),
        ]
        for s in sets
    ]
    facts = [f for s in sets for f in s.facts]
    rows.append(["all", str(sum(f.right for f in facts)), str(len(facts)), *[""] * 4])
    counts = defaultdict[str, list[bool]](list)
    for fact in facts:
        counts[fact.name].append(fact.right)
    measures = [[name, str(sum(x)), str(len(x))] for name, x in counts.items()]
    by_set, by_measure = (
        markdown_table(HEAD, rows),
        markdown_table(("measure", *HEAD[1:3]), measures),
    )
    return f"{by_set}\n\n{DETAILS}\n\n{by_measure}\n"

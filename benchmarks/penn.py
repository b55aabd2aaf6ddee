"""Real clips with hand-made labels (Penn Action): evaluation alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from jaxtyping import Bool, Float, Int
from rich.table import Table

from benchmarks.actions.action_folder import action_key, make_whole
from benchmarks.actions.captured_videos import data_folder
from benchmarks.names import BenchmarkOptions
from benchmarks.parallel import ActionDisplay, each
from benchmarks.scoring import SetErrors, run_to_prediction, set_errors
from benchmarks.tables import cell, markdown_table, write_texts
from imocap_core.artifacts.schemas import Sync
from imocap_core.body.layouts import layout_names
from imocap_core.camera.projection import intrinsics
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.errors import WrongUse
from imocap_core.lifter.infer import lift
from imocap_core.lifter.lifter_network import load_lifter, to_common
from imocap_core.pipeline import runner
from imocap_core.pipeline.runner import Display, Job
from imocap_core.workspace import Workspace

# Clips of Penn Action: hand-made labels in pixels, and groups of clips as actions.
#
# The data is for evaluation alone. Frame rates are unknown; 30 frames a second are assumed.

LAYOUT, FPS = "penn13", 30.0
SEED, GROUP = 7, 4  # of the choice of clips; clips of a group
LEAST_FRAMES = 30
FILE = "penn_labels.npz"


@dataclass(frozen=True)
class Clip:
    """One clip: xy_px (T, 13, 2) labels in the order of `penn13`; visible (T, 13)."""

    id: int
    action: str
    size: tuple[int, int]
    xy_px: Float[np.ndarray, "T 13 2"]
    visible: Bool[np.ndarray, "T 13"]


def penn_clips(root: Path) -> list[Clip]:
    """All clips that are long enough. WorkFailed when the data is not there."""
    with np.load(data_folder(root, "penn") / FILE) as stored:
        table = {name: stored[name] for name in stored.files}
    xy, visible = table["xy16"] / 16.0, table["visible"].astype(bool)
    clips = []
    for k, (first, frames) in enumerate(zip(table["first"], table["frames"], strict=True)):
        span = slice(int(first), int(first + frames))
        width, height = (int(x) for x in table["size"][k])
        number, action = int(table["id"][k]), str(table["action"][k])
        if frames >= LEAST_FRAMES:
            clips.append(Clip(number, action, (width, height), xy[span], visible[span]))
    return clips


def groups_of(clips: Sequence[Clip], action: str, count: int) -> list[list[Clip]]:
    """Groups of clips of one action, no clip twice: the same ones for the same seed, and the first
    ones of a larger count."""
    of_action = sorted((c for c in clips if c.action == action), key=lambda c: c.id)
    order = np.random.default_rng(SEED).permutation(len(of_action))
    most = min(count, len(order) // GROUP)
    return [[of_action[k] for k in order[GROUP * g : GROUP * (g + 1)]] for g in range(most)]


def make_group(folder: Path, group: Sequence[Clip]) -> None:
    """An action folder whose videos are some clips."""

    def write(new: Path) -> None:
        (new / "keypoints").mkdir()
        videos = []
        for clip in group:
            name = f"c{clip.id:04d}"
            table = np.concatenate([clip.xy_px, clip.visible[..., None]], axis=-1)
            np.savez(new / "keypoints" / f"{name}.npz", keypoints=table)
            videos.append(
                {
                    "id": name,
                    "keypoints": f"keypoints/{name}.npz",
                    "format": "npz",
                    "layout": LAYOUT,
                    "fps": FPS,
                    "size": list(clip.size),
                }
            )
        action = {"name": folder.name, "videos": videos}
        (new / "action.yaml").write_text(yaml.safe_dump(action, sort_keys=False))

    ids = [[c.id, c.xy_px.tolist(), c.visible.tolist()] for c in group]
    make_whole(folder, action_key([folder.name, LAYOUT, FPS, ids], []), write)


# A limb hidden in the middle third of a clip: where the lifter has it, and straight interpolation.
#
# Each of the four limbs in turn. The lifted pose is put into the picture by one scale and shift a
# frame, from the joints that are seen (scaled orthographic).

NAMES = layout_names(LAYOUT)
LIMBS = tuple(
    tuple(NAMES.index(f"{side}_{joint}") for joint in joints)
    for side in ("left", "right")
    for joints in (("elbow", "wrist"), ("knee", "ankle"))
)
BODY = list(range(1, len(NAMES)))  # all but the head, which is no joint of SMPL
IN_SMPL = [SMPL_JOINTS.index(NAMES[k]) for k in BODY]
NEAR = 0.2  # of the torso
LEAST_SEEN = 4  # joints in a frame that place the pose


@dataclass(frozen=True)
class HiddenLimbs:
    """Shares of hidden joints within 0.2 of the torso, %."""

    lifter_pct: float
    straight_pct: float


def hidden_limbs(clips: Sequence[Clip]) -> HiddenLimbs:
    """All limbs of all clips together."""
    near = [_near(clip, limb) for clip in clips for limb in LIMBS]
    lifted, straight = (np.concatenate([n[k] for n in near]) for k in (0, 1))
    return HiddenLimbs(100 * float(lifted.mean()), 100 * float(straight.mean()))


def _near(clip: Clip, limb: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Of each hidden label, whether the lifter's and the interpolated place are near it."""
    frames = np.arange(len(clip.xy_px))
    hidden = frames[len(frames) // 3 : 2 * len(frames) // 3]
    visible_mask = clip.visible.copy()
    visible_mask[np.ix_(hidden, np.asarray(limb))] = False
    torso_px = np.linalg.norm(_middle(clip, "shoulder") - _middle(clip, "hip"), axis=-1)
    is_known = clip.visible[np.ix_(hidden, np.asarray(limb))]
    answers = (
        lifted_px(clip, visible_mask)[np.ix_(hidden, np.asarray(limb))],
        straight_px(clip.xy_px, visible_mask, limb)[hidden],
    )
    truth = clip.xy_px[np.ix_(hidden, np.asarray(limb))]
    lifted, straight = (
        np.nan_to_num(np.linalg.norm(x - truth, axis=-1), nan=np.inf)[is_known]
        < NEAR * np.median(torso_px)
        for x in answers
    )
    return lifted, straight


def lifted_px(clip: Clip, visible_mask: np.ndarray) -> Float[np.ndarray, "T 13 2"]:
    """The lifter's joints in the picture; NaN where too few joints are seen, and of the head."""
    K = intrinsics(float(max(clip.size)), clip.size)
    rays = (clip.xy_px - K[:2, 2]) / K[0, 0]
    points, confidence = to_common(rays, visible_mask.astype(float), LAYOUT)
    pose = lift(load_lifter(), points, confidence, FPS).joints[:, IN_SMPL, :2]
    weight = visible_mask[:, BODY].astype(float)[..., None]
    total = np.maximum(weight.sum(1, keepdims=True), 1.0)
    centre, middle = (
        (weight * x).sum(1, keepdims=True) / total for x in (pose, clip.xy_px[:, BODY])
    )
    p, x = pose - centre, clip.xy_px[:, BODY] - middle
    scale = (weight * p * x).sum((1, 2)) / np.maximum((weight * p * p).sum((1, 2)), 1e-9)
    out = np.full(clip.xy_px.shape, np.nan)
    placed = weight.sum((1, 2)) >= LEAST_SEEN
    out[:, BODY] = np.where(placed[:, None, None], middle + scale[:, None, None] * p, np.nan)
    return out


def straight_px(
    xy_px: Float[np.ndarray, "T 13 2"], visible_mask: np.ndarray, limb: Sequence[int]
) -> Float[np.ndarray, "T L 2"]:
    """Each joint on a straight line between the frames that show it; NaN where none does."""
    frames = np.arange(len(xy_px))
    out = np.full((len(xy_px), len(limb), 2), np.nan)
    for n, joint in enumerate(limb):
        shown: Int[np.ndarray, " _"] = np.flatnonzero(visible_mask[:, joint])
        if len(shown):
            for axis in range(2):
                out[:, n, axis] = np.interp(frames, shown, xy_px[shown, joint, axis])
    return out


def _middle(clip: Clip, joint: str) -> Float[np.ndarray, "T 2"]:
    """Middle of the left and right joint."""
    return np.asarray(
        clip.xy_px[:, [NAMES.index(f"{side}_{joint}") for side in ("left", "right")]].mean(axis=1)
    )


# Strangers: one clip of a group replaced by one of another action, which screening should exclude.

STRANGERS = 2  # of each group


@dataclass(frozen=True)
class Screened:
    """Whether the stranger was excluded, and how many of the others."""

    stranger_excluded: bool
    others: int
    others_excluded: int


def with_strangers(
    chosen: Mapping[str, Sequence[Sequence[Clip]]],
) -> list[tuple[str, list[Clip], int]]:
    """Groups with one clip replaced by another action's: name, clips, the stranger's number."""
    rng, mixed = np.random.default_rng(SEED), []
    for action, groups in chosen.items():
        others = [clip for a, of_a in chosen.items() if a != action for g in of_a for clip in g]
        for k, group in enumerate(groups if others else ()):
            for n in range(STRANGERS):
                place, stranger = int(rng.integers(GROUP)), others[int(rng.integers(len(others)))]
                clips = [stranger if v == place else clip for v, clip in enumerate(group)]
                mixed.append((f"{action}_{k:02d}{'ab'[n]}", clips, place))
    return mixed


def screened_group(
    display: Display, root: Path, name: str, group: Sequence[Clip], stranger: int
) -> Screened:
    """Which clips the synchronisation excludes, at the defaults; stranger: its number."""
    job, shown = _job(display, root, name, group)
    done = {o.stage: o.stored for o in runner.run(job, shown, job.pipeline.upstream("sync"))}
    sync = done["sync"].decode(Sync)
    excluded = {sync.ids.index(video) for video in sync.excluded}
    return Screened(stranger in excluded, len(group) - 1, len(excluded - {stranger}))


PARTS = ("groups", "lifter", "strangers")
HEAD = ("action", "groups", "left out, % of height", "within 10 %", "monocular, %")
HEAD_LIFTER = ("clips", "lifter within 0.2 torso, %", "straight, %")
HEAD_STRANGERS = ("strangers excluded", "others excluded")


@dataclass(frozen=True)
class PennRow:
    """One action: the errors of its groups, and of limbs hidden from the lifter in their clips."""

    action: str
    groups: list[SetErrors]
    clips: int
    limbs: HiddenLimbs | None
    screened: list[Screened]


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The table as Markdown (`--only` actions, `--videos` groups of each), and its folder."""
    clips = penn_clips(workspace.root)
    actions = sorted({clip.action for clip in clips})
    _check(options, actions)
    parts = options.variants or PARTS
    chosen = {a: groups_of(clips, a, options.videos) for a in options.only or actions}
    tasks = [
        (f"{action}_{k:02d}", (workspace.root, f"{action}_{k:02d}", group))
        for action, groups in chosen.items()
        for k, group in enumerate(groups)
        if "groups" in parts
    ]
    ends = list(each(group_errors, tasks, options.jobs, display))
    mixed = [
        (name, (workspace.root, name, group, stranger))
        for name, group, stranger in (with_strangers(chosen) if "strangers" in parts else ())
    ]
    screened_ends = list(each(screened_group, mixed, options.jobs, display))
    errors = {end.name: end.result for end in ends if end.result is not None}
    screened = {end.name: end.result for end in screened_ends if end.result is not None}
    faults = [f"{end.name}: {end.fault}" for end in ends if end.result is None]
    faults += [f"{end.name}: {end.fault}" for end in screened_ends if end.result is None]
    rows = []
    for action, groups in chosen.items():
        shown = [clip for group in groups for clip in group]
        of_action = [e for name, e in errors.items() if name.rpartition("_")[0] == action]
        limbs = hidden_limbs(shown) if "lifter" in parts else None
        of_strangers = [s for name, s in screened.items() if name.rpartition("_")[0] == action]
        rows.append(PennRow(action, of_action, len(shown), limbs, of_strangers))
    text = markdown(rows)
    folder = workspace.root / "artifacts" / "benchmark" / "penn"
    write_texts(folder, {"table.md": text})
    return [text, *faults, f"Written to {folder}"]


def group_errors(display: Display, root: Path, name: str, group: Sequence[Clip]) -> SetErrors:
    """The errors of one group, made and run at the defaults."""
    job, shown = _job(display, root, name, group)
    return set_errors(run_to_prediction(job, shown))


def _job(
    display: Display, root: Path, name: str, group: Sequence[Clip]
) -> tuple[Job, ActionDisplay]:
    """A group as an action that can be run."""
    folder = root / "artifacts" / "benchmark" / "penn"
    action, shown = folder / "actions" / name, ActionDisplay(display, name)
    make_group(action, group)
    return Workspace(folder).ready_job(str(action), [], shown), shown


def markdown(rows: Sequence[PennRow]) -> str:
    """A row an action, and the median over all groups."""
    cells = [_cells(row.action, row.groups, row.clips, row.limbs, row.screened) for row in rows]
    every = [error for row in rows for error in row.groups]
    limbs = [row.limbs for row in rows if row.limbs is not None]
    mean = None
    if limbs:
        shares = [(x.lifter_pct, x.straight_pct) for x in limbs]
        mean = HiddenLimbs(*(float(x) for x in np.mean(shares, axis=0)))
    screened = [s for row in rows for s in row.screened]
    cells.append(_cells("all", every, sum(row.clips for row in rows), mean, screened))
    return markdown_table((*HEAD, *HEAD_LIFTER, *HEAD_STRANGERS), cells) + "\n"


def _cells(
    name: str,
    groups: Sequence[SetErrors],
    clips: int,
    limbs: HiddenLimbs | None,
    screened: Sequence[Screened],
) -> list[str]:
    columns = [[g.error_pct, g.share_10, g.monocular_pct] for g in groups]
    medians = (
        [cell(float(x), 2) for x in np.nanmedian(columns, axis=0)]
        if groups
        else [cell(None, 2)] * 3
    )
    shares = (None, None) if limbs is None else (limbs.lifter_pct, limbs.straight_pct)
    strangers, others = (
        sum(s.stranger_excluded for s in screened),
        sum(s.others_excluded for s in screened),
    )
    counts = [f"{strangers} of {len(screened)}", f"{others} of {sum(s.others for s in screened)}"]
    return [
        name, str(len(groups)), *medians, str(clips), *(cell(x, 1) for x in shares),
        *(counts if screened else ["–", "–"]),
    ]  # fmt: skip


def _check(options: BenchmarkOptions, actions: Sequence[str]) -> None:
    """WrongUse, naming what there is, for an unknown action or part."""
    for option, given, there in (
        ("--only", options.only, actions),
        ("--variants", options.variants, PARTS),
    ):
        for name in given:
            if name not in there:
                raise WrongUse(f"{option} {name}: expected one of {', '.join(there)}")

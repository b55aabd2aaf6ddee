"""Captured joints of a skeleton as those of another body: the same rotations, other bones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from benchmarks.actions import captured_videos
from benchmarks.actions.action_folder import action_key, make_action
from benchmarks.synthetic.captured import align_trials, hip_middle
from imocap_core.body import load_free_body
from imocap_core.body.model import Model
from imocap_core.conventions import EVAL_14, SMPL_JOINTS
from imocap_core.pipeline.runner import Display, Job
from imocap_core.pipeline.source import closure
from imocap_core.workspace import Workspace

SIDES = ("left", "right")
LIMB_BONES = {"knee": "hip", "ankle": "knee", "elbow": "shoulder", "wrist": "elbow"}
PARENT_OF = {f"{s}_{far}": f"{s}_{near}" for s in SIDES for far, near in LIMB_BONES.items()}
PARENT_OF |= {"left_shoulder": "neck", "right_shoulder": "neck", "head": "neck"}
LIMBS = tuple(f"{s}_{end}" for end in LIMB_BONES for s in SIDES)
BODY_PARENT = {**PARENT_OF, "neck": "pelvis", "left_hip": "pelvis", "right_hip": "pelvis"}


def bone_lengths_m(model: Model, betas: Float[np.ndarray, "10"]) -> dict[str, float]:
    """Lengths of a shape's bones by their far ends; the trunk's is from pelvis to neck."""
    rest = model.shape(torch.as_tensor(betas)).joints_rest.numpy()
    place = {name: rest[SMPL_JOINTS.index(name)] for name in SMPL_JOINTS}
    return {
        far: float(np.linalg.norm(place[far] - place[near])) for far, near in BODY_PARENT.items()
    }


def limb_lengths_m(joints_m: Float[np.ndarray, "T 14 3"]) -> dict[str, float]:
    """Median lengths of captured limbs by their far ends."""
    row = EVAL_14.index
    return {
        far: float(
            np.median(
                np.linalg.norm(joints_m[:, row(far)] - joints_m[:, row(PARENT_OF[far])], axis=-1)
            )
        )
        for far in LIMBS
    }


def with_bones(
    joints_m: Float[np.ndarray, "T 14 3"], ratio: Mapping[str, float]
) -> Float[np.ndarray, "T 14 3"]:
    """Joints whose bones are longer by a ratio, by their far ends, in the same directions.

    The path, about the first frame's place on the ground, is as much longer as the legs, so that
    feet in contact stay in contact.
    """
    row = EVAL_14.index
    legs = float(np.mean([ratio[f"{s}_{end}"] for s in SIDES for end in ("knee", "ankle")]))
    middle = hip_middle(joints_m)
    origin = middle[:1] * np.array([1.0, 1.0, 0.0])
    out = np.empty_like(joints_m)
    placed = origin + legs * (middle - origin)
    for name in ("left_hip", "right_hip", "neck"):
        out[:, row(name)] = placed + ratio[name] * (joints_m[:, row(name)] - middle)
    waiting = dict(PARENT_OF)
    done = {"left_hip", "right_hip", "neck"}
    while waiting:
        far = next(name for name, near in waiting.items() if near in done)
        near = waiting.pop(far)
        bone = joints_m[:, row(far)] - joints_m[:, row(near)]
        out[:, row(far)] = out[:, row(near)] + ratio[far] * bone
        done.add(far)
    return out


# An action by two performers: real performances, bodies of their own, simulated detections.

PERFORMERS = ("A", "B")
SHAPE_SD = 0.5  # of the performers' coefficients; a thigh's length then differs by about a tenth
PURPOSE = 29  # of the random numbers: the performers' shapes


def bone_ratios(action: str) -> dict[str, dict[str, float]]:
    """Of each performer, the lengths of bones over those of the mean shape."""
    model = load_free_body()
    mean = bone_lengths_m(model, np.zeros(10))
    ratios = {}
    for number, name in enumerate(PERFORMERS):
        betas = SHAPE_SD * captured_videos.video_rng(action, number, PURPOSE).standard_normal(10)
        lengths = bone_lengths_m(model, betas)
        ratios[name] = {bone: lengths[bone] / mean[bone] for bone in mean}
    return ratios


def performances(files: Sequence[Path], videos: int) -> list[captured_videos.CapturedVideo]:
    """As many performances of each file, of the first performer's first."""
    ratios = bone_ratios(files[0].stem)
    captured = captured_videos.videos_of_performances(files, videos)
    return [
        replace(
            video,
            joints_m=with_bones(video.joints_m, ratios[PERFORMERS[v // videos]]),
            skeleton_m=None,
        )
        for v, video in enumerate(captured)
    ]


def ready_performers(
    root: Path, files: Sequence[Path], videos: int, detector: str, display: Display
) -> Job:
    """A job of the action, whose folder is made first unless the same code and data made it."""
    name = files[0].stem
    key = action_key([closure(Path(__file__)), name, detector, videos], list(files))
    folder = root / "actions" / name
    make_action(folder, name, lambda: performances(files, videos), detector, {}, key)
    return Workspace(root).ready_job(str(folder), [], display)


# Sets of captured takes of one action as actions: each filmed once, by a camera of its own.


def takes(file: Path, first: int, count: int) -> list[captured_videos.CapturedVideo]:
    """Some takes, in one scene; a take has the same camera and random numbers in every set."""
    with np.load(file) as stored:
        index, fps = stored["common14_idx"], float(stored["fps"])
        trials = range(first, first + count)
        joints = [stored[f"trial_{v:02d}"][:, index].astype(np.float64) for v in trials]
    videos = [captured_videos.captured_video(trial, fps) for trial in align_trials(joints)]
    return [replace(video, place=first + v) for v, video in enumerate(videos)]


def ready_takes(
    root: Path, file: Path, first: int, count: int, detector: str, display: Display
) -> Job:
    """A job of the action, whose folder is made first unless the same code and data made it."""
    name = f"{count}_from_{first}"
    key = action_key([closure(Path(__file__)), name, detector], [file])
    folder = root / "actions" / name
    make_action(folder, name, lambda: takes(file, first, count), detector, {}, key)
    return Workspace(root).ready_job(str(folder), [], display)

"""Takes: captured performances on a body, rendered by one static camera, as small films."""

from __future__ import annotations

import tempfile
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation, Slerp

from benchmarks.actions.action_folder import action_key
from benchmarks.actions.captured_videos import (
    PLACEMENTS,
    CapturedVideo,
    data_folder,
    trial_stance,
    trial_videos,
)
from benchmarks.rendered_action import true_pose
from benchmarks.synthetic.films import FilmedMotion, film_motion, render_frames
from benchmarks.synthetic.retargeting import RetargetedMotion, perform
from imocap_core.body import Shaped, load_free_body
from imocap_core.body.model import Model
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.io.truth import model_text
from imocap_core.io.video import write_h264
from imocap_core.pipeline.source import closure

SIZE = (480, 360)
FPS = 30.0
CRF = 16  # better than the compilations that are made of them
SHAPES = ((0.0, 0.0, 0.0), (2.0, 1.5, 0.0))  # added to betas: a body shape for each performer
TALK_S = 2.5
GESTURES = {"left_elbow": 0.5, "right_elbow": 0.4, "right_shoulder": 0.15, "head": 0.12}  # radians


@dataclass(frozen=True)
class Take:
    """One performance and its camera.

    file: below the data folder, without suffix (trials/tennis_serve_jarua). placement: of the
    camera. room: background and clothes. slow: pictures a frame of the capture, 4 for a camera
    of 120 frames a second. talks: only stands there and gesticulates.
    """

    file: str
    trial: int
    placement: int
    room: int = 0
    performer: int = 0
    slow: int = 1
    talks: bool = False

    @property
    def name(self) -> str:
        """The name of its files."""
        parts = [Path(self.file).name, self.trial, self.placement, self.room, self.performer]
        return "_".join(map(str, [*parts, self.slow])) + "_talks" * self.talks


def make_takes(root: Path, folder: Path, takes: Sequence[Take]) -> dict[Take, Path]:
    """The films of some takes, rendered where they are missing; `.npz` beside each is its truth."""
    key = action_key([closure(Path(__file__))], [])[:12]
    files = {take: folder / key / f"{take.name}.mp4" for take in takes}
    missing: dict[str, list[Take]] = defaultdict(list)
    for take, file in files.items():
        if not file.is_file():
            missing[take.file].append(take)
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    for name, group in missing.items():
        _render(_data(root, name), group, files)
    return files


def _data(root: Path, name: str) -> Path:
    return data_folder(root, Path(name).parent.as_posix()) / f"{Path(name).name}.npz"


def _render(file: Path, takes: Sequence[Take], files: dict[Take, Path]) -> None:
    model = load_free_body(dtype=torch.float64)
    captured = trial_videos(file, 1 + max(take.trial for take in takes))
    trials = sorted({take.trial for take in takes})
    clips = [_skeleton(captured[t]) for t in trials]
    betas, motions = perform(model, *trial_stance(file), clips)
    for take in takes:
        motion = motions[trials.index(take.trial)]
        _write(files[take], take, captured[take.trial], motion, model, betas)


def _write(
    file: Path,
    take: Take,
    captured: CapturedVideo,
    motion: RetargetedMotion,
    model: Model,
    betas: np.ndarray,
) -> None:
    shape = betas + np.pad(SHAPES[take.performer], (0, len(betas) - 3))
    shaped = model.shape(torch.as_tensor(shape))
    if take.talks:
        motion = talking(motion)
    filmed = film_motion(slowed(motion, take.slow), shaped, PLACEMENTS[take.placement], SIZE)
    file.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".take.", dir=file.parent) as draft:
        new = Path(draft) / file.name
        seed = 100 * take.performer + take.room
        write_h264(new, render_frames(filmed, shaped, take.room % 4, seed), FPS, crf=CRF)
        if not take.talks:
            truth: dict[str, Any] = _truth(captured, filmed, shaped, shape, take.slow)
            truth["model"] = np.array(model_text(model.name, model.digest))
            np.savez(file.with_suffix(".npz"), **truth)
        new.rename(file)


def talking(motion: RetargetedMotion) -> RetargetedMotion:
    """The stance of the first frame, held, with gestures of the arms and the head."""
    t = np.arange(round(TALK_S * FPS)) / FPS
    R = np.repeat(motion.R_local[:1], len(t), axis=0)
    for number, (joint, reach) in enumerate(GESTURES.items()):
        j = SMPL_JOINTS.index(joint)
        angle = reach * np.sin(2 * np.pi * (0.7 + 0.23 * number) * t + number)
        R[:, j] = R[:, j] @ Rotation.from_rotvec(angle[:, None] * [0.2, 1.0, 0.3]).as_matrix()
    return RetargetedMotion(R, np.repeat(motion.transl[:1], len(t), axis=0))


def slowed(motion: RetargetedMotion, times: int) -> RetargetedMotion:
    """Interpolated: `times` - 1 poses between two."""
    if times == 1:
        return motion
    frames = np.arange(len(motion.transl))
    every = np.linspace(0, frames[-1], times * (len(frames) - 1) + 1)
    joints = [
        Slerp(frames, Rotation.from_matrix(R))(every).as_matrix()
        for R in motion.R_local.swapaxes(0, 1)
    ]
    path = np.stack([np.interp(every, frames, x) for x in motion.transl.T], axis=1)
    return RetargetedMotion(np.stack(joints, axis=1), path)


def _truth(
    captured: CapturedVideo, filmed: FilmedMotion, shaped: Shaped, betas: np.ndarray, slow: int
) -> dict[str, Any]:
    """The take's truth in the common world of its action, a row each frame of the film."""
    rows = np.linspace(0, len(captured.phase) - 1, slow * (len(captured.phase) - 1) + 1)
    lifted = captured.R_common_from_scene @ np.array([0.0, 0.0, filmed.floor_m])
    on_floor = replace(
        captured,
        frames=np.arange(len(rows)),
        phase=np.interp(rows, np.arange(len(captured.phase)), captured.phase),
        truth_joints_m=filmed.joints,
        truth_names=SMPL_JOINTS,
        segments=None,
        t_common=captured.t_common + lifted,
    )
    parts = on_floor.truth("take", filmed.K, filmed.R, filmed.t)
    parts |= true_pose("take", filmed.motion, on_floor, shaped, betas)
    return {name.removeprefix("take/"): value for name, value in parts.items()}


def _skeleton(video: CapturedVideo) -> Float[np.ndarray, "T S 3"]:
    assert video.skeleton_m is not None, "trials have their skeleton"
    return video.skeleton_m

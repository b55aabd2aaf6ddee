"""Action folders of one performance that four cameras film at once: films, and nothing else given.

A captured performance is put on the free body. Every camera has a focal length of its own, begins
at a moment of its own, between the others' frames, and is looked at by the real detector.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
import yaml
from jaxtyping import Float

from benchmarks.actions.action_folder import action_key, is_made, make_filmed
from benchmarks.actions.captured_videos import SEED, trial_stance, trial_videos, video_rng
from benchmarks.synthetic.captured import CAMERA_PLACEMENTS
from benchmarks.synthetic.films import film_motion, render_frames
from benchmarks.synthetic.retargeting import RetargetedMotion, perform
from imocap_core.body import Shaped, load_free_body
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.io.truth import model_text
from imocap_core.io.video import write_h264
from imocap_core.motion.multiview.timeline import sample, sample_rotations
from imocap_core.pipeline.source import closure
from imocap_core.synthetic.cameras import CameraPlacement

SIZE, CRF = (640, 480), 20
LATEST_START_S, EARLIEST_END_S = 0.4, 0.4  # after the first camera's, and before the last one's
FOCAL_RANGE = (0.75, 1.25)  # of the picture's larger side
TURN_DEG, RISE_M = 20.0, 0.4  # of a camera's place about its usual one
PURPOSE = 31  # of the random numbers


@dataclass(frozen=True)
class EventShot:
    """What one camera films: fractional frames of the motion, and its place."""

    frames: Float[np.ndarray, " N"]
    view: CameraPlacement


@dataclass(frozen=True)
class Performance:
    """A motion on a body, and its frame rate."""

    motion: RetargetedMotion
    shaped: Shaped
    fps: float


def make_event(folder: Path, file: Path, trial: int) -> None:
    """Write the event of a trial into `folder` unless it was made already."""
    key = action_key([closure(Path(__file__)), file.stem, trial], [file])
    if is_made(folder, key):
        return
    model = load_free_body(dtype=torch.float64)
    captured = trial_videos(file, trial + 1)[trial]
    assert captured.skeleton_m is not None, "trials have their skeleton"
    betas, motions = perform(model, *trial_stance(file), [captured.skeleton_m])
    performance = Performance(motions[0], model.shape(torch.as_tensor(betas)), captured.fps)
    write_event(folder, performance, key)


def write_event(folder: Path, performance: Performance, key: str) -> None:
    """Films, truth and action.yaml of a performance; complete or not at all."""
    make_filmed(folder, key, lambda new: _write(new, folder.name, performance))


def shots_of(name: str, frames: int, fps: float) -> list[EventShot]:
    """The four cameras of an event, drawn by its name."""
    shots = []
    for v, usual in enumerate(CAMERA_PLACEMENTS):
        rng = video_rng(name, v, PURPOSE)
        first = rng.uniform(0, LATEST_START_S * fps)
        last = frames - 1 - rng.uniform(0, EARLIEST_END_S * fps)
        view = replace(
            usual,
            azimuth_deg=usual.azimuth_deg + rng.uniform(-TURN_DEG, TURN_DEG),
            height_m=usual.height_m + rng.uniform(-RISE_M, RISE_M),
            focal_per_width=rng.uniform(*FOCAL_RANGE),
        )
        shots.append(EventShot(np.arange(first, last), view))
    return shots


def moments(motion: RetargetedMotion, frames: Float[np.ndarray, " N"]) -> RetargetedMotion:
    """A motion at fractional frames."""
    R = sample_rotations(torch.as_tensor(motion.R_local), frames).numpy()
    return RetargetedMotion(R, sample(torch.as_tensor(motion.transl), frames).numpy())


def _write(folder: Path, name: str, performance: Performance) -> None:
    motion, shaped = performance.motion, performance.shaped
    truth: dict[str, Any] = {
        "joint_names": np.array(SMPL_JOINTS),
        "model": np.array(model_text(shaped.model.name, shaped.model.digest)),
        "phase_end": float(len(motion.transl) - 1),
    }
    declared = []
    for v, shot in enumerate(shots_of(name, len(motion.transl), performance.fps)):
        video = f"v{v + 1}"
        whole = film_motion(motion, shaped, shot.view, SIZE)  # the floor is that of all frames
        shown = moments(whole.motion, shot.frames)
        posed = shaped.pose(torch.as_tensor(shown.R_local), torch.as_tensor(shown.transl))
        filmed = replace(whole, motion=shown, joints=posed.joints.numpy())
        file = folder / "videos" / f"{video}.mp4"
        write_h264(file, render_frames(filmed, shaped, v, SEED), performance.fps, crf=CRF)
        parts = {"joints": filmed.joints, "phase": shot.frames}
        parts |= {"K": filmed.K, "R": filmed.R, "t": filmed.t}
        truth |= {f"{video}/{part}": value for part, value in parts.items()}
        declared.append({"id": video, "video": f"videos/{video}.mp4", "keypoints": "detect"})
    np.savez(folder / "truth.npz", **truth)
    action = {"name": name, "event": True, "videos": declared, "truth": "truth.npz"}
    (folder / "action.yaml").write_text(yaml.safe_dump(action, sort_keys=False))

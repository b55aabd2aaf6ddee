"""Action folders of films: captured performances put on the free body and rendered.

The stages see videos that say `keypoints: detect`, and nothing else. A folder appears complete or
not at all, and is made again when what it is made of has changed.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from shutil import rmtree
from typing import Any

import cv2
import numpy as np
import torch
import yaml

from benchmarks.actions.action_folder import MADE, action_key, is_made
from benchmarks.actions.captured import SEED, Shot, trial_shots
from imocap_core.body import Shaped, load_free_body
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.io.video import write_h264
from imocap_core.pipeline.source import closure
from imocap_core.synthetic.cameras import standing_height_px
from imocap_core.synthetic.captured import VIEWPOINTS
from imocap_core.synthetic.embodied import embody
from imocap_core.synthetic.rendered import Shooting, film_frames, seen_from, shoot, true_points_px

LAYOUT = "mediapipe33"
BODY_LAYOUT = "body33"  # the same keypoints where they are on the body, to measure against
SIZES = {False: (640, 480), True: (320, 240)}
POINTS = "points.npz"  # where the points truly are: for the detector's errors alone
CRF = 20  # H.264 quality, about that of a video from the Internet
Say = Callable[[float, str], None]


def key_of(name: str, file: Path, videos: int, small: bool) -> str:
    """Digest of all that an action is made of."""
    return action_key([closure(Path(__file__)), name, videos, small], [file])


def make_rendered(folder: Path, name: str, file: Path, videos: int, small: bool, say: Say) -> None:
    """Write the action `name` of a file of trials into `folder` unless it is there already."""
    key = key_of(name, file, videos, small)
    if is_made(folder, key):
        return
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{folder.name}.", dir=folder.parent) as draft:
        new = Path(draft) / "new"
        (new / "videos").mkdir(parents=True)
        _write(new, name, trial_shots(file, videos), SIZES[small], say)
        (new / MADE).write_text(key)
        if folder.exists():
            rmtree(folder)
        new.rename(folder)


def _write(folder: Path, name: str, shots: list[Shot], size: tuple[int, int], say: Say) -> None:
    model = load_free_body(dtype=torch.float64)
    say(0.0, "putting the performances on a body")
    betas, motions = embody(model, [shot.joints_m for shot in shots])
    shaped = model.shape(torch.as_tensor(betas))
    truth: dict[str, Any] = {
        "joint_names": np.array(SMPL_JOINTS),
        "phase_end": max(float(shots[0].phase[-1]), 1.0),
    }
    points: dict[str, Any] = {}
    declared = []
    for v, (shot, motion) in enumerate(zip(shots, motions, strict=True)):
        video = f"v{v + 1}"
        say((v + 1) / (len(shots) + 1), f"filming {video}")
        shooting = shoot(motion, shaped, VIEWPOINTS[v], size)
        file = folder / "videos" / f"{video}.mp4"
        write_h264(file, film_frames(shooting, shaped, v, SEED), shot.fps, crf=CRF)
        truth |= _scored(shot, shooting).truth(video, shooting.K, shooting.R, shooting.t)
        seen = seen_points(shooting, shaped)
        points |= {f"{video}/{part}": value for part, value in seen.items()}
        declared.append({"id": video, "video": f"videos/{video}.mp4", "keypoints": "detect"})
    np.savez(folder / "truth.npz", **truth)
    np.savez(folder / POINTS, **points)
    action = {"name": name, "videos": declared, "truth": "truth.npz"}
    (folder / "action.yaml").write_text(yaml.safe_dump(action, sort_keys=False))


def _scored(shot: Shot, shooting: Shooting) -> Shot:
    """What the truth holds of it: the filmed body's joints, the floor where it lay before."""
    lifted = shot.R_common_from_stage @ np.array([0.0, 0.0, shooting.floor_m])
    return replace(
        shot, scored_m=shooting.joints, names=SMPL_JOINTS, t_common=shot.t_common + lifted
    )


def seen_points(shooting: Shooting, shaped: Shaped) -> dict[str, Any]:
    """Where the layout's points are seen, how tall the person is in the picture, and from where."""
    xy_px, depth_m = true_points_px(shooting, shaped, BODY_LAYOUT)
    return {
        "xy_px": xy_px,
        "height_px": standing_height_px(shaped, shooting.K[1, 1], depth_m),
        "names": np.array(shaped.model.points(BODY_LAYOUT).names),
        "columns": np.array(shaped.model.points(BODY_LAYOUT).columns),
        "side": np.array(seen_from(shooting.joints, shooting.R, shooting.t)),
    }

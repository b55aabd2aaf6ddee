"""Human3.6M in the paper's protocol: one motion, four real cameras, each video other frames of it.

VideoPose3D's files hold no cameras: each subject's four are found by resection from all of the
subject's 3D and 2D joints (lens distortion left out). They are scored against and given to the
oracle; the stages see detections alone. The monocular estimate is the simulated one.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.actions.captured import Filmed, Floats, Shot, drawn
from benchmarks.actions.choice import Choice
from imocap_core.camera.resection import Resection, resect
from imocap_core.conventions import EVAL_12, EVAL_14
from imocap_core.errors import WorkFailed
from imocap_core.io.h36m import (
    FILE_2D,
    FILE_3D,
    FPS,
    H36M_17,
    SIZE,
    Recording,
    read_h36m,
)
from imocap_core.synthetic.captured import COCO18, HIP_OUT
from imocap_core.synthetic.samplings import sample_frames

SUBJECTS = ("S9", "S11")
ACTIONS = ("SittingDown", "Sitting", "Smoking", "Photo", "Phoning")  # the paper's
FRAMES = 2000
PAIRS = 6000  # for a camera's resection


def files_of(choice: Choice) -> list[Path]:
    """The two files."""
    assert choice.data is not None, "Choice asks for it"
    missing = [f for name in (FILE_3D, FILE_2D) if not (f := choice.data / name).is_file()]
    if missing:
        raise WorkFailed(
            f"there is no {missing[0]}; --data: the folder with {FILE_3D} and {FILE_2D} as "
            "VideoPose3D's preparation scripts write them"
        )
    return [choice.data / FILE_3D, choice.data / FILE_2D]


def action_names(choice: Choice) -> list[str]:
    """Subject and recording, as `S9_Photo_1`, of the paper's five actions."""
    return [f"{s}_{a.replace(' ', '_')}" for s, a in _chosen(choice)]


def shots_of(choice: Choice, name: str) -> list[Shot]:
    """The first 2000 frames of a recording, resampled for each video."""
    known = {f"{s}_{a.replace(' ', '_')}": (s, a) for s, a in _chosen(choice)}
    subject, action = known[name]
    everything = _read(choice)
    recording = everything[subject][action]
    length = min(len(recording.joints_m), FRAMES)
    joints = recording.joints_m[:length, [H36M_17.index(j) for j in EVAL_14]]
    phase = np.arange(length, dtype=np.float64)
    shots = []
    for v in range(choice.videos):
        camera = camera_of(everything[subject], subject, v)
        xy = coco18_pixels(recording.xy_px[v, :length])
        kept = sample_frames(choice.sampling, length, v, drawn(name, v, 0))
        filmed = Filmed(camera.K, camera.R, camera.t, xy, SIZE)
        whole = recording.joints_m[:length]
        shots.append(Shot(joints, phase, kept, FPS, filmed=filmed, scored_m=whole, names=H36M_17))
    return shots


def camera_of(recordings: dict[str, Recording], subject: str, camera: int) -> Resection:
    """A camera from all that the subject's recordings show before it."""
    columns = [H36M_17.index(name) for name in EVAL_12]
    world = np.concatenate([r.joints_m[:, columns].reshape(-1, 3) for r in recordings.values()])
    pixels = np.concatenate(
        [r.xy_px[camera][:, columns].reshape(-1, 2) for r in recordings.values()]
    )
    rng = drawn(subject, camera, 2)
    rows = rng.permutation(len(world))[:PAIRS]
    try:
        found = resect(world[rows], pixels[rows], rng)
    except ValueError as error:
        raise WorkFailed(f"h36m: {subject}, camera {camera + 1}: {error}") from error
    if not found.ok:
        raise WorkFailed(
            f"h36m: {subject}, camera {camera + 1}: {found.status}; the 2D and the 3D file do not "
            "belong together"
        )
    return found


def coco18_pixels(xy_px: Floats) -> Floats:
    """(T, 17, 2) of Human3.6M as COCO's 18 (T, 18, 2): hips moved out to where they are marked, the
    neck between the shoulders, the face unseen (NaN)."""
    at = {name: xy_px[:, k] for k, name in enumerate(H36M_17)}
    left, right = at["left_hip"], at["right_hip"]
    at["left_hip"], at["right_hip"] = (
        left + HIP_OUT * (left - right),
        right + HIP_OUT * (right - left),
    )
    at["neck"] = (at["left_shoulder"] + at["right_shoulder"]) / 2
    unseen = np.full_like(left, np.nan)
    known = {*EVAL_12, "neck"}
    return np.stack([at[n] if n in known else unseen for n in COCO18], axis=1)


def _chosen(choice: Choice) -> list[tuple[str, str]]:
    found = [
        (subject, action)
        for subject in SUBJECTS
        for action in sorted(_read(choice).get(subject, {}))
        if action.split(" ")[0] in ACTIONS
    ]
    if not found:
        raise WorkFailed(
            f"{choice.data}: expected subjects {', '.join(SUBJECTS)} with actions "
            f"{', '.join(ACTIONS)}, found none of them"
        )
    return found


def _read(choice: Choice) -> dict[str, dict[str, Recording]]:
    return _read_files(*files_of(choice))


@cache
def _read_files(file_3d: Path, file_2d: Path) -> dict[str, dict[str, Recording]]:
    try:
        return read_h36m(file_3d.parent)
    except ValueError as error:
        raise WorkFailed(str(error)) from error

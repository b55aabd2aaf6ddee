"""Human3.6M in the paper's protocol: one motion, four real cameras, each video other frames of it.

VideoPose3D's files hold no cameras: each subject's four are solved by resection from all of the
subject's 3D and 2D joints (lens distortion left out). They serve scoring and the oracle; the stages
read detections alone. The monocular estimate is the simulated one.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from jaxtyping import Float

from benchmarks.actions.captured import CapturedVideo, RecordedView, video_rng
from benchmarks.actions.choice import Choice
from benchmarks.actions.h36m_files import FILE_2D, FILE_3D, FPS, H36M_17, SIZE, Recording, read_h36m
from benchmarks.actions.resection import Resection, resect
from benchmarks.synthetic.captured import COCO18, HIP_OUTWARD
from benchmarks.synthetic.frame_sampling import sample_frames
from imocap_core.conventions import EVAL_12, EVAL_14
from imocap_core.errors import WorkFailed

SUBJECTS = ("S9", "S11")
ACTIONS = ("SittingDown", "Sitting", "Smoking", "Photo", "Phoning")  # the paper's
FRAMES = 2000
PAIRS = 6000  # for a camera's resection


def h36m_files(choice: Choice) -> list[Path]:
    """The file of the 3D joints and that of the detections; WorkFailed when one is missing."""
    assert choice.data is not None, "Choice asks for it"
    missing = [f for name in (FILE_3D, FILE_2D) if not (f := choice.data / name).is_file()]
    if missing:
        raise WorkFailed(
            f"{missing[0]} does not exist; --data: expected the folder with {FILE_3D} and "
            f"{FILE_2D} as VideoPose3D's preparation scripts write them"
        )
    return [choice.data / FILE_3D, choice.data / FILE_2D]


def h36m_actions(choice: Choice) -> list[str]:
    """Subject and recording, as `S9_Photo_1`, of the paper's five actions."""
    return list(_chosen(choice))


def h36m_videos(choice: Choice, name: str) -> list[CapturedVideo]:
    """The first 2000 frames of a recording, resampled for each video."""
    subject, action = _chosen(choice)[name]
    recordings = _read(choice)[subject]
    recording = recordings[action]
    length = min(len(recording.joints_m), FRAMES)
    all_joints = recording.joints_m[:length]
    joints = all_joints[:, [H36M_17.index(j) for j in EVAL_14]]
    phase = np.arange(length, dtype=np.float64)
    videos = []
    for v in range(choice.videos):
        camera = camera_of(recordings, subject, v)
        xy_px = coco18_pixels(recording.xy_px[v, :length])
        frames = sample_frames(choice.sampling, length, v, video_rng(name, v, 0))
        view = RecordedView(camera.K, camera.R, camera.t, xy_px, SIZE)
        videos.append(
            CapturedVideo(
                joints, phase, frames, FPS,
                recorded=view, truth_joints_m=all_joints, truth_names=H36M_17,
            )
        )  # fmt: skip
    return videos


def camera_of(recordings: dict[str, Recording], subject: str, camera: int) -> Resection:
    """A camera by resection from all recordings of a subject; WorkFailed when that fails."""
    columns = [H36M_17.index(name) for name in EVAL_12]
    world = np.concatenate([r.joints_m[:, columns].reshape(-1, 3) for r in recordings.values()])
    pixels = np.concatenate(
        [r.xy_px[camera][:, columns].reshape(-1, 2) for r in recordings.values()]
    )
    rng = video_rng(subject, camera, 2)
    rows = rng.permutation(len(world))[:PAIRS]
    try:
        resection = resect(world[rows], pixels[rows], rng)
    except ValueError as error:
        raise WorkFailed(f"h36m: {subject}, camera {camera + 1}: {error}") from error
    if not resection.ok:
        raise WorkFailed(
            f"h36m: {subject}, camera {camera + 1}: {resection.status}; the 2D and the 3D file do "
            "not belong together"
        )
    return resection


def coco18_pixels(xy_px: Float[np.ndarray, "T 17 2"]) -> Float[np.ndarray, "T 18 2"]:
    """Human3.6M's 17 joints as COCO's 18: hips moved outwards to where they are marked, the neck
    between the shoulders, the face missing (NaN)."""
    pixels = {name: xy_px[:, k] for k, name in enumerate(H36M_17)}
    left, right = pixels["left_hip"], pixels["right_hip"]
    pixels["left_hip"], pixels["right_hip"] = (
        left + HIP_OUTWARD * (left - right),
        right + HIP_OUTWARD * (right - left),
    )
    pixels["neck"] = (pixels["left_shoulder"] + pixels["right_shoulder"]) / 2
    missing = np.full_like(left, np.nan)
    available = {*EVAL_12, "neck"}
    return np.stack([pixels[n] if n in available else missing for n in COCO18], axis=1)


def _chosen(choice: Choice) -> dict[str, tuple[str, str]]:
    """Name of the action -> subject and recording."""
    chosen = {
        f"{subject}_{action.replace(' ', '_')}": (subject, action)
        for subject in SUBJECTS
        for action in sorted(_read(choice).get(subject, {}))
        if action.split(" ")[0] in ACTIONS
    }
    if not chosen:
        raise WorkFailed(
            f"{choice.data}: expected subjects {', '.join(SUBJECTS)} with actions "
            f"{', '.join(ACTIONS)}, got none of them"
        )
    return chosen


def _read(choice: Choice) -> dict[str, dict[str, Recording]]:
    return _read_files(*h36m_files(choice))


@cache
def _read_files(file_3d: Path, file_2d: Path) -> dict[str, dict[str, Recording]]:
    try:
        return read_h36m(file_3d.parent)
    except ValueError as error:
        raise WorkFailed(str(error)) from error

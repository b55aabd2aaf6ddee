"""Synthetic demo actions from a seed: `actions/yoga`, four videos of one sun salutation, and
`actions/taichi`, four of one tai chi form, whose detections have hands."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
import yaml
from jaxtyping import Float

from imocap_core.body import Shaped, load_free_body
from imocap_core.body.model import pose_from_rotations
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.errors import WorkFailed
from imocap_core.executors.processes import worker_processes
from imocap_core.executors.tasks import Report, Task, perform
from imocap_core.files import draft_prefix
from imocap_core.io.truth import model_text
from imocap_core.io.video import write_h264
from imocap_core.synthetic.choreography import PHASE_PER_S
from imocap_core.synthetic.detector import Detections
from imocap_core.synthetic.taichi import TAICHI_SPANS, make_taichi_clip, taichi_body
from imocap_core.synthetic.yoga import keys_of
from imocap_core.synthetic.yoga_clip import (
    LAYOUT,
    YOGA_SPANS,
    DemoClip,
    draw_betas,
    make_yoga_clip,
    pictures,
)

DEMOS = ("yoga", "taichi")
_COUNT = {"yoga": len(YOGA_SPANS), "taichi": len(TAICHI_SPANS)}
_WORKERS = 2
_CRF = 18  # H.264 quality: hardly any loss


def make_demo(
    name: str,
    folder: Path,
    seed: int,
    progress: Callable[[str], None] | None = None,
    ending: Callable[[Path], None] = lambda draft: None,
) -> None:
    """Make a demo action: `folder` becomes its action folder (an older one is replaced).

    The folder appears complete or not at all. The same seed gives the same keypoints, truth and
    frames. ValueError for an unknown name.

    Args:
        progress: called with a sentence after each video.
        ending: called with the complete draft, before it becomes `folder`.
    """
    if name not in DEMOS:
        raise ValueError(f"demo: expected one of {', '.join(DEMOS)}, got {name!r}")
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=draft_prefix(folder), dir=folder.parent) as aside:
        draft = Path(aside) / "new"
        truth = _write_videos(name, seed, draft, progress)
        np.savez(draft / "truth.npz", **truth)
        (draft / "action.yaml").write_text(yaml.safe_dump(_declaration(name), sort_keys=False))
        ending(draft)
        if folder.exists():
            folder.rename(Path(aside) / "old")
        draft.rename(folder)


def video_id(index: int) -> str:
    """v1 to v4."""
    return f"v{index + 1}"


def _declaration(name: str) -> dict[str, Any]:
    videos = [
        {
            "id": video_id(index),
            "video": f"videos/{video_id(index)}.mp4",
            "keypoints": f"keypoints/{video_id(index)}",
            "format": "openpose",
            "layout": LAYOUT,
        }
        for index in range(_COUNT[name])
    ]
    return {"name": name, "videos": videos, "truth": "truth.npz"}


def _write_videos(
    name: str, seed: int, draft: Path, progress: Callable[[str], None] | None
) -> dict[str, Any]:
    """Write all videos and keypoints below `draft`; return the arrays of truth.npz."""
    count = _COUNT[name]
    truths: dict[int, dict[str, Float[np.ndarray, "..."]]] = {}
    tasks = [
        Task(video_id(index), _write_video, (name, seed, index, draft)) for index in range(count)
    ]
    with worker_processes(_WORKERS) as workers:
        for done, end in enumerate(perform(tasks, workers), start=1):
            if end.state != "done":
                raise WorkFailed(f"the demo: {end.task.name}: {end.fault}")
            truths[tasks.index(end.task)] = end.result
            if progress is not None:
                progress(f"made {end.task.name} ({done} of {count} videos)")
    truth = truth_of_action(name)
    for index in range(count):
        truth |= {f"{video_id(index)}/{key}": value for key, value in truths[index].items()}
    return truth


def _write_video(
    report: Report, demo: str, seed: int, index: int, draft: Path
) -> dict[str, Float[np.ndarray, "..."]]:
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    if demo == "yoga":
        shaped = demo_body(seed)
        clip = make_yoga_clip(seed, index, shaped)
    else:
        shaped = taichi_body(seed)
        clip = make_taichi_clip(seed, index, shaped)
    name = video_id(index)
    write_keypoints(draft / "keypoints" / name, name, clip)
    video = draft / "videos" / f"{name}.mp4"
    video.parent.mkdir(parents=True, exist_ok=True)
    write_h264(video, pictures(clip, seed, index, shaped), clip.fps, crf=_CRF)
    return clip_truth(clip, shaped)


def clip_truth(clip: DemoClip, shaped: Shaped) -> dict[str, Float[np.ndarray, "..."]]:
    """The truth of one video, as truth.npz has it."""
    hands = {} if clip.hands is None else {"hands": clip.hands.points_m}
    return hands | {
        "joints": clip.joints,
        "K": clip.camera.K,
        "R": clip.camera.R_cam_from_world[0],
        "t": clip.camera.t[0],
        "R_frames": clip.camera.R_cam_from_world,
        "phase": clip.motion.phase,
        "theta": pose_from_rotations(torch.as_tensor(clip.R_smpl)).numpy(),
        "trans": clip.transl,
        "betas": shaped.coefficients.numpy(),
    }


def truth_of_action(demo: str) -> dict[str, Any]:
    """The arrays of a truth that all videos of a demo share."""
    body = load_free_body()
    return {
        "model": np.array(model_text(body.name, body.digest)),
        "joint_names": np.array(SMPL_JOINTS),
        "phase_end": np.float64(keys_of(demo)[-1].time_s * PHASE_PER_S),
    }


def demo_body(seed: int) -> Shaped:
    """The body of the performer of yoga, for a seed."""
    model = load_free_body(dtype=torch.float64)
    return model.shape(torch.as_tensor(draw_betas(seed, model.num_betas)))


def write_keypoints(folder: Path, name: str, clip: DemoClip) -> None:
    """One OpenPose BODY_25 file per frame; the performer may come after a false person."""
    folder.mkdir(parents=True)
    for frame, false_person in enumerate(clip.false_people):
        people = [_person(clip.detections, frame)]
        if clip.hands is not None:
            people[0] |= _hands(clip.hands.detections, frame)
        if false_person is not None:
            people.insert(frame % 2, _person(false_person, 0))
        file = folder / f"{name}_{frame:012d}_keypoints.json"
        file.write_text(json.dumps({"version": 1.3, "people": people}))


def _person(detections: Detections, frame: int) -> dict[str, Any]:
    rows = np.column_stack([detections.xy_px[frame], detections.confidence[frame]])
    return {"person_id": [-1], "pose_keypoints_2d": [round(float(v), 4) for v in rows.ravel()]}


def _hands(detections: Detections, frame: int) -> dict[str, Any]:
    rows = np.concatenate(
        [detections.xy_px[frame], detections.confidence[frame][..., None]], axis=-1
    )
    sides = zip(("left", "right"), rows, strict=True)
    return {
        f"hand_{side}_keypoints_2d": [round(float(v), 4) for v in hand.ravel()]
        for side, hand in sides
    }

"""Action folders made of captured motion: simulated detections and estimates, and the truth.

These files are all that the stages read. A folder appears complete or not at all, and is made again
when the code that made it has changed.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
import yaml
from jaxtyping import Int
from scipy.ndimage import median_filter

from benchmarks.actions.captured_videos import (
    SIZE,
    CapturedVideo,
    RecordedView,
    placement,
    video_rng,
)
from benchmarks.synthetic.captured import coco18_points, hip_middle, place_camera, stature_m
from benchmarks.synthetic.simulated import detect_person, estimate
from imocap_core.camera.projection import project
from imocap_core.conventions import EVAL_14
from imocap_core.metrics.whole_body import SEGMENTS
from imocap_core.synthetic.cameras import CameraPlacement
from imocap_core.synthetic.detector import Detections

MADE = ".made.json"
OUTLIER_VIEW = CameraPlacement(80.0, 4.0, 1.3, 0.95)


def action_key(recipe: Any, files: Sequence[Path]) -> str:
    """Digest of all that an action is made of: `recipe` (code and choice, as JSON takes it) and the
    files of captured motion."""
    digest = hashlib.sha256(json.dumps(recipe, sort_keys=True).encode())
    for file in files:
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def is_made(folder: Path, key: str) -> bool:
    """Whether the action in a folder was made under `key`."""
    made = folder / MADE
    return made.is_file() and made.read_text() == key


def make_whole(folder: Path, key: str, write: Callable[[Path], None]) -> None:
    """What `write` leaves in a new folder becomes `folder`, unless that was made under `key`; a
    folder that is there is replaced, or stays where writing fails."""
    if is_made(folder, key):
        return
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{folder.name}.", dir=folder.parent) as draft:
        new = Path(draft) / "new"
        new.mkdir()
        write(new)
        (new / MADE).write_text(key)
        if folder.exists():
            shutil.rmtree(folder)
        new.rename(folder)


def make_filmed(folder: Path, key: str, write: Callable[[Path], None]) -> None:
    """`make_whole` of an action with rendered videos, on one thread."""

    def film(new: Path) -> None:
        torch.set_num_threads(1)
        cv2.setNumThreads(1)
        (new / "videos").mkdir()
        write(new)

    make_whole(folder, key, film)


def make_action(
    folder: Path,
    name: str,
    videos: Callable[[], Sequence[CapturedVideo]],
    detector: str,
    params: dict[str, Any],
    key: str,
) -> None:
    """Write the action `name` into `folder` unless it was made under the same key."""
    make_whole(folder, key, lambda new: _write(new, name, videos(), detector, params))


def _write(
    folder: Path,
    name: str,
    captured: Sequence[CapturedVideo],
    detector: str,
    params: dict[str, Any],
) -> None:
    truth: dict[str, Any] = {
        "joint_names": np.array(captured[0].truth_names),
        "phase_end": max(float(captured[0].phase[-1]), 1.0),
        "segment_joints": np.array(SEGMENTS),
    }
    videos = []
    for v, motion in enumerate(captured):
        video = f"v{v + 1}"
        place = v if motion.place is None else motion.place
        rng = video_rng(name, place, 1)
        view = motion.recorded or _simulated_view(
            motion, OUTLIER_VIEW if motion.is_outlier else placement(place)
        )
        joints_cam = motion.joints_m @ view.R.T + view.t
        estimated = estimate(joints_cam, motion.fps, rng)[motion.frames]
        detections = _detections(motion, view, detector, rng)
        _write_openpose(folder / "keypoints" / video, video, detections, motion.frames)
        (folder / "initial").mkdir(exist_ok=True)
        np.savez(folder / "initial" / f"{video}.npz", joints=estimated, joint_names=list(EVAL_14))
        if not motion.is_outlier:
            truth |= motion.truth(video, view.K, view.R, view.t)
        videos.append(_declaration(video, motion, view.size))
    np.savez(folder / "truth.npz", **truth)
    action = {"name": name, "videos": videos, "truth": "truth.npz", "params": params}
    (folder / "action.yaml").write_text(yaml.safe_dump(action, sort_keys=False))


def _simulated_view(motion: CapturedVideo, viewpoint: CameraPlacement) -> RecordedView:
    """A simulated camera, and the true pixels of COCO's keypoints."""
    K, R, t = place_camera(viewpoint, motion.joints_m, SIZE)
    return RecordedView(K, R, t, project(coco18_points(motion.joints_m), K, R, t), SIZE)


def _detections(
    motion: CapturedVideo, view: RecordedView, detector: str, rng: np.random.Generator
) -> Detections:
    if motion.recorded is not None:
        visible = np.asarray(np.isfinite(view.xy_px).all(axis=-1, keepdims=True))
        confidence = visible[..., 0].astype(np.float64)
        return Detections(np.nan_to_num(view.xy_px) * visible, confidence)
    depth = (hip_middle(motion.joints_m) @ view.R.T + view.t)[:, 2]
    height_px = view.K[0, 0] * stature_m(motion.joints_m) / median_filter(depth, 5)
    return detect_person(view.xy_px, height_px, motion.fps, detector, rng)


def _declaration(video: str, motion: CapturedVideo, size: tuple[int, int]) -> dict[str, Any]:
    """A video of action.yaml; the frame rate of a resampled one is the mean rate of its frames."""
    return {
        "id": video,
        "keypoints": f"keypoints/{video}",
        "format": "openpose",
        "layout": "coco18",
        "fps": round(motion.fps * len(motion.frames) / len(motion.phase), 3),
        "size": list(size),
        "initial": f"initial/{video}.npz",
        "initial_format": "joints_npz",
    }


def _write_openpose(
    folder: Path, video: str, detections: Detections, frames: Int[np.ndarray, " N"]
) -> None:
    folder.mkdir(parents=True)
    for number, frame in enumerate(frames):
        rows = np.column_stack([detections.xy_px[frame], detections.confidence[frame]])
        person = {"pose_keypoints_2d": [round(float(value), 3) for value in rows.ravel()]}
        file = folder / f"{video}_{number:012d}_keypoints.json"
        file.write_text(json.dumps({"version": 1.3, "people": [person]}))


# One variant of an action, and where it lies below a benchmark's folder.


@dataclass(frozen=True)
class ActionVariant:
    """A variant of an action; `variant`, its name, is for a benchmark to give."""

    folder: Path
    action: str

    @property
    def variant(self) -> str:
        """What is done to the action."""
        raise NotImplementedError

    @property
    def name(self) -> str:
        """The name of the varied action."""
        return f"{self.action}-{self.variant}"

    @property
    def action_folder(self) -> Path:
        """Its action folder."""
        return self.folder / "actions" / self.name

    @property
    def score_file(self) -> Path:
        """The file of its numbers."""
        return self.folder / "scores" / f"{self.name}.json"

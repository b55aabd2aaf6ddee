"""Action folders made of captured motion: simulated detections and estimates, and the truth.

The stages see these files only. A folder appears complete or not at all, and is made again when
the code that made it has changed.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from benchmarks.actions.captured import SIZE, Filmed, Shot, drawn
from imocap_core.camera.projection import project
from imocap_core.conventions import EVAL_14
from imocap_core.synthetic.cameras import Viewpoint
from imocap_core.synthetic.captured import (
    VIEWPOINTS,
    coco18_points,
    hip_middle,
    place_camera,
    stature_m,
)
from imocap_core.synthetic.detector import Detections
from imocap_core.synthetic.detector_levels import detect_person
from imocap_core.synthetic.estimator import estimate

MADE = ".made.json"
OUTLIER_VIEW = Viewpoint(80.0, 4.0, 1.3, 0.95)


def action_key(told: Any, files: Sequence[Path]) -> str:
    """Digest of all that an action is made of: code and choice (`told`), the captured motion."""
    digest = hashlib.sha256(json.dumps(told, sort_keys=True).encode())
    for file in files:
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def is_made(folder: Path, key: str) -> bool:
    """Whether the action in a folder was made under `key`."""
    made = folder / MADE
    return made.is_file() and made.read_text() == key


def make_action(
    folder: Path,
    name: str,
    shots: Callable[[], Sequence[Shot]],
    detector: str,
    params: dict[str, Any],
    key: str,
) -> None:
    """Write the action `name` into `folder` unless it was made under the same key."""
    if is_made(folder, key):
        return
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{folder.name}.", dir=folder.parent) as draft:
        new = Path(draft) / "new"
        new.mkdir()
        _write(new, name, shots(), detector, params)
        (new / MADE).write_text(key)
        if folder.exists():
            shutil.rmtree(folder)
        new.rename(folder)


def _write(
    folder: Path, name: str, shots: Sequence[Shot], detector: str, params: dict[str, Any]
) -> None:
    truth: dict[str, Any] = {
        "joint_names": np.array(shots[0].names),
        "phase_end": max(float(shots[0].phase[-1]), 1.0),
    }
    videos = []
    for v, shot in enumerate(shots):
        video = f"v{v + 1}"
        rng = drawn(name, v, 1)
        filmed = shot.filmed or _film(shot, OUTLIER_VIEW if shot.stranger else VIEWPOINTS[v])
        joints_cam = shot.joints_m @ filmed.R.T + filmed.t
        estimated = estimate(joints_cam, shot.fps, rng)[shot.kept]
        found = _detections(shot, filmed, detector, rng)
        _write_openpose(folder / "keypoints" / video, video, found, shot.kept)
        (folder / "initial").mkdir(exist_ok=True)
        np.savez(folder / "initial" / f"{video}.npz", joints=estimated, joint_names=list(EVAL_14))
        if not shot.stranger:
            truth |= shot.truth(video, filmed.K, filmed.R, filmed.t)
        videos.append(_declaration(video, shot, filmed.size))
    np.savez(folder / "truth.npz", **truth)
    action = {"name": name, "videos": videos, "truth": "truth.npz", "params": params}
    (folder / "action.yaml").write_text(yaml.safe_dump(action, sort_keys=False))


def _film(shot: Shot, view: Viewpoint) -> Filmed:
    """A simulated camera, and where it sees what COCO's keypoints mark."""
    K, R, t = place_camera(view, shot.joints_m, SIZE)
    return Filmed(K, R, t, project(coco18_points(shot.joints_m), K, R, t), SIZE)


def _detections(shot: Shot, filmed: Filmed, detector: str, rng: np.random.Generator) -> Detections:
    if shot.filmed is not None:
        seen = np.asarray(np.isfinite(filmed.xy_px).all(axis=-1, keepdims=True))
        trust = seen[..., 0].astype(np.float64)
        return Detections(np.nan_to_num(filmed.xy_px) * seen, trust)
    depth = (hip_middle(shot.joints_m) @ filmed.R.T + filmed.t)[:, 2]
    height_px = filmed.K[0, 0] * stature_m(shot.joints_m) / median_filter(depth, 5)
    return detect_person(filmed.xy_px, height_px, shot.fps, detector, rng)


def _declaration(video: str, shot: Shot, size: tuple[int, int]) -> dict[str, Any]:
    """A resampled video's frame rate is the mean rate of the frames it keeps."""
    return {
        "id": video,
        "keypoints": f"keypoints/{video}",
        "format": "openpose",
        "layout": "coco18",
        "fps": round(shot.fps * len(shot.kept) / len(shot.phase), 3),
        "size": list(size),
        "initial": f"initial/{video}.npz",
        "initial_format": "joints_npz",
    }


def _write_openpose(folder: Path, video: str, found: Detections, kept: NDArray[np.int64]) -> None:
    folder.mkdir(parents=True)
    for number, frame in enumerate(kept):
        rows = np.column_stack([found.xy_px[frame], found.confidence[frame]])
        person = {"pose_keypoints_2d": [round(float(value), 3) for value in rows.ravel()]}
        file = folder / f"{video}_{number:012d}_keypoints.json"
        file.write_text(json.dumps({"version": 1.3, "people": [person]}))

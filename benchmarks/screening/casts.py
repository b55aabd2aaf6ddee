"""Casts: the films of one action from which scenes are put together.

An action is a window of a training clip. Every film of a cast shows another performance of it from
another side, through a simulated detector and with a limb out of sight for a while. A mirrored film
shows the mirror image of the performance from the mirrored side: the flipped picture, detected.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.ndimage import median_filter

from benchmarks.actions.captured import PLACEMENTS, SIZE, video_rng
from benchmarks.sync.training_scenes import CAPTURED_FPS, performances_of, training_clip
from benchmarks.synthetic.captured import COCO18, coco18_points, hip_middle, place_camera, stature_m
from benchmarks.synthetic.detector_presets import detect_person
from imocap_core.camera.projection import project
from imocap_core.conventions import EVAL_14, mirror_indices
from imocap_core.synthetic.cameras import CameraPlacement
from imocap_core.synthetic.detector import Detections

FILMS, MIRRORED_FILMS = 9, 2  # of a cast; the first ones are filmed once more, mirrored
LENGTH_S = (2.4, 3.6)  # of the window
OCCLUDED_SHARE = 0.5  # of the films
OCCLUSION_S = (0.4, 1.5)
LIMBS = (
    *(("left_elbow", "left_wrist"), ("right_elbow", "right_wrist")),
    *(("left_knee", "left_ankle"), ("right_knee", "right_ankle")),
    ("left_knee", "left_ankle", "right_knee", "right_ankle"),
)


@dataclass(frozen=True)
class CastFilm:
    """One video: what the detector gives, and the true joints on the stage."""

    joints_m: Float[np.ndarray, "T 14 3"]
    detections: Detections
    fps: float = CAPTURED_FPS

    def __len__(self) -> int:
        return len(self.joints_m)


@dataclass(frozen=True)
class Cast:
    """All films of one action; those of `mirrored` show the first films' performances mirrored."""

    clip: str
    films: list[CastFilm]
    mirrored: list[CastFilm]


def cast_of(file: Path, clip: str, detector: str) -> Cast:
    """The cast of a training clip."""
    rng = video_rng(f"cast {clip}", 0, 0)
    joints = _window(training_clip(file, clip), rng)
    performances, _ = performances_of(joints, int(rng.integers(1 << 30)), videos=FILMS)
    sides = rng.permutation(len(PLACEMENTS))[:FILMS]
    views = [PLACEMENTS[side] for side in sides]
    films = [_film(x, views[v], detector, clip, v) for v, x in enumerate(performances)]
    mirrored = [
        _film(mirrored_performance(performances[v]), _opposite(views[v]), detector, clip, FILMS + v)
        for v in range(MIRRORED_FILMS)
    ]
    return Cast(clip, films, mirrored)


def mirrored_performance(joints_m: Float[np.ndarray, "T 14 3"]) -> Float[np.ndarray, "T 14 3"]:
    """The performance in a mirror."""
    return np.asarray(joints_m[:, list(mirror_indices(EVAL_14))] * np.array([-1.0, 1.0, 1.0]))


def _window(joints: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The window in which the performer moves most about the hips."""
    length = min(len(joints), round(rng.uniform(*LENGTH_S) * CAPTURED_FPS))
    about = joints - hip_middle(joints)[:, None]
    moved = np.linalg.norm(np.diff(about, axis=0), axis=-1).mean(axis=1)
    before = np.concatenate([[0.0], np.cumsum(moved)])
    first = int(np.argmax(before[length - 1 :] - before[: len(before) - length + 1]))
    return joints[first : first + length]


def _opposite(view: CameraPlacement) -> CameraPlacement:
    return replace(view, azimuth_deg=-view.azimuth_deg, roll_deg=-view.roll_deg)


def _film(joints: np.ndarray, view: CameraPlacement, detector: str, clip: str, v: int) -> CastFilm:
    rng = video_rng(f"film {clip}", v, 1)
    return CastFilm(joints, occluded(detected(joints, view, CAPTURED_FPS, detector, rng), rng))


def detected(
    joints_m: Float[np.ndarray, "T 14 3"],
    view: CameraPlacement,
    fps: float,
    detector: str,
    rng: np.random.Generator,
) -> Detections:
    """What a simulated detector gives of a performance from a side."""
    K, R, t = place_camera(view, joints_m, SIZE)
    depth = (hip_middle(joints_m) @ R.T + t)[:, 2]
    height_px = K[0, 0] * stature_m(joints_m) / median_filter(depth, 5)
    pixels = project(coco18_points(joints_m), K, R, t)
    return detect_person(pixels, height_px, fps, detector, rng)


def occluded(detections: Detections, rng: np.random.Generator) -> Detections:
    """Detections of which, in some films, one limb is missing for a while."""
    visible = np.ones(detections.confidence.shape, dtype=bool)
    if rng.random() < OCCLUDED_SHARE:
        frames = round(rng.uniform(*OCCLUSION_S) * CAPTURED_FPS)
        first = int(rng.integers(0, max(1, len(visible) - frames)))
        limb = LIMBS[int(rng.integers(len(LIMBS)))]
        visible[first : first + frames, [COCO18.index(name) for name in limb]] = False
    return Detections(
        np.where(visible[..., None], detections.xy_px, 0.0),
        np.where(visible, detections.confidence, 0.0),
    )

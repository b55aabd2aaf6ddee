"""Casts: the films of one action from which scenes are put together.

An action is a window of a training clip. Every film of a cast shows another performance of it from
another side, through a simulated detector and with a limb out of sight for a while. A mirrored film
shows the mirror image of the performance from the mirrored side: the flipped picture, detected.
"""

from __future__ import annotations

import importlib
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.ndimage import median_filter

from benchmarks.actions.action_folder import action_key
from benchmarks.actions.captured_videos import PLACEMENTS, SIZE, video_rng
from benchmarks.sync_scenes import CAPTURED_FPS, performances_of, training_clip
from benchmarks.synthetic.captured import COCO18, coco18_points, hip_middle, place_camera, stature_m
from benchmarks.synthetic.simulated import detect_person
from imocap_core.artifacts.schemas import (
    CameraMotion,
    InitialSmpl,
    Keypoints,
    VideoCameraMotion,
    VideoKeypoints,
)
from imocap_core.camera.camera_motion import static_camera
from imocap_core.camera.projection import project
from imocap_core.conventions import EVAL_14, mirror_indices
from imocap_core.params import Params
from imocap_core.pipeline.action import Action, Declaration
from imocap_core.pipeline.source import closure, module_name
from imocap_core.pipeline.stage import Context, Inputs
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


# Monocular fits of a cast's films by the stage `initial_smpl` itself, from keypoints alone.

STAGE = "initial_smpl"
LAYOUT = "coco18"


@dataclass(frozen=True)
class FittedFilm:
    """One video as the screening sees it, and its true joints.

    poses: SMPL's joints of the monocular fit, metres, in the camera's axes.
    """

    poses: Float[np.ndarray, "T 24 3"]
    keypoints: VideoKeypoints
    true_joints_m: Float[np.ndarray, "T 14 3"]


@dataclass(frozen=True)
class FittedCast:
    """`Cast`, fitted."""

    clip: str
    films: list[FittedFilm]
    mirrored: list[FittedFilm]


def fitted_cast(
    data: Path, clip: str, detector: str, params: Params, script: Path, cache: Path
) -> FittedCast:
    """A clip's cast with the fits of all its films; fits are read where the same code made them.

    data: the training clips; script: of the stage; cache: the folder of fits.
    """
    cast = cast_of(data, clip, detector)
    films = [*cast.films, *cast.mirrored]
    keypoints = [_keypoints(film, f"v{number}") for number, film in enumerate(films)]
    recipe = [
        closure(Path(__file__)),
        closure(script),
        clip,
        detector,
        repr(params.initial_smpl),
        repr(params.fit),
    ]
    file = cache / f"{clip}-{action_key(recipe, [data])[:16]}.npz"
    if not file.is_file():
        file.parent.mkdir(parents=True, exist_ok=True)
        _save(file, _fits(keypoints, params, script))
    with np.load(file) as stored:
        fitted = [
            FittedFilm(stored[k.id], k, film.joints_m)
            for k, film in zip(keypoints, films, strict=True)
        ]
    count = len(cast.films)
    return FittedCast(clip, fitted[:count], fitted[count:])


def _fits(keypoints: list[VideoKeypoints], params: Params, script: Path) -> InitialSmpl:
    """The stage's result, called with inputs in memory."""
    declared = tuple(
        Declaration(id=k.id, keypoints=k.id, fps=k.fps, size=k.size) for k in keypoints
    )
    cameras = CameraMotion(videos=[_camera(k, params) for k in keypoints])
    inputs = Inputs(STAGE, {}, {Keypoints: Keypoints(videos=keypoints), CameraMotion: cameras})
    with tempfile.TemporaryDirectory(prefix="imocap-") as folder:
        here = Path(folder)
        context = Context(
            STAGE, 0, frozenset({"initial"}), lambda _share, _what: None, here,
            Action(here, "screening", declared),
        )  # fmt: skip
        fits = importlib.import_module(module_name(script)).run(context, inputs, params)
    assert isinstance(fits, InitialSmpl)
    return fits


def _save(file: Path, fits: InitialSmpl) -> None:
    draft = file.with_suffix(".draft.npz")
    joints: dict[str, Any] = {video.id: np.asarray(video.joints) for video in fits.videos}
    np.savez(draft, **joints)
    draft.rename(file)


def _keypoints(film: CastFilm, name: str) -> VideoKeypoints:
    missing = film.detections.confidence <= 0
    xy_px = np.where(missing[..., None], np.nan, film.detections.xy_px)
    low, high = np.nanmin(xy_px, axis=1), np.nanmax(xy_px, axis=1)
    return VideoKeypoints(
        id=name,
        fps=film.fps,
        size=SIZE,
        layout=LAYOUT,
        video=None,
        focal_px=None,
        initial=None,
        initial_format=None,
        frames=np.arange(len(film)),
        xy_px=xy_px,
        confidence=film.detections.confidence,
        person_box_px=np.concatenate([low, high], axis=1),
        tracks_found=1,
        presence=1.0,
        note="",
    )


def _camera(video: VideoKeypoints, params: Params) -> VideoCameraMotion:
    still = static_camera(
        len(video.frames), video.size, None, params.camera_motion.assumed_focal_factor
    )
    return VideoCameraMotion(
        id=video.id,
        K=still.K,
        focal_source=still.focal_source,
        motion=still.motion,
        note=still.note,
        residual_px=still.residual_px,
        H_first_from_frame=still.H_first_from_frame,
        R_first_from_frame=still.R_first_from_frame,
        zoom=still.zoom,
        inliers=still.inliers,
        xy_first_px=video.xy_px,
    )

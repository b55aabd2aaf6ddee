"""Monocular fits of a cast's films by the stage `initial_smpl` itself, from keypoints alone."""

from __future__ import annotations

import importlib
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from benchmarks.actions.action_folder import action_key
from benchmarks.actions.captured import SIZE
from benchmarks.screening.casts import CastFilm, cast_of
from imocap_core.artifacts.schemas import (
    CameraMotion,
    InitialSmpl,
    Keypoints,
    VideoCameraMotion,
    VideoKeypoints,
)
from imocap_core.camera.camera_motion import static_camera
from imocap_core.params import Params
from imocap_core.pipeline.action import Action, Declaration
from imocap_core.pipeline.source import closure, module_name
from imocap_core.pipeline.stage import Context, Inputs

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

"""Motions as a moving camera films them: relative to its place in every frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.artifacts.schemas import Camera, CameraMotion, InitialSmpl, VideoMotion

Paths = Mapping[str, Float[np.ndarray, "T 3"]]  # places of moving cameras by video, metres


def paths_of_initial(initial: InitialSmpl, camera_motion: CameraMotion) -> Paths:
    """Paths of the cameras, with the units of the monocular fits."""
    units = {unit.id: unit.unit_m for unit in initial.path_units}
    return {c.id: units[c.id] * c.path for c in camera_motion.videos if c.id in units}


def paths_of(cameras: Sequence[Camera]) -> Paths:
    """Paths of solved cameras."""
    return {camera.id: camera.path_m for camera in cameras if len(camera.path_m)}


def relative_motions(motions: Sequence[VideoMotion], paths: Paths) -> list[VideoMotion]:
    """Every motion in its first frame's axes, moved to where a camera that stays in its first
    place would have to see it."""
    return [
        relative_motion(motion, paths[motion.id]) if motion.id in paths else motion
        for motion in motions
    ]


def relative_motion(motion: VideoMotion, path_m: Float[np.ndarray, "T 3"]) -> VideoMotion:
    """One motion less the camera's places."""
    moved = {"trans": motion.trans - path_m, "joints": motion.joints - path_m[:, None]}
    return motion.model_copy(update=moved)

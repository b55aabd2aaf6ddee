"""A calibrated rig's triangulation as truth: calibration.npz and trc_reference.npz.

Both files stand beside action.yaml and come from a Pose2Sim project: cameras that ran together,
and a triangulation of their detections. ``calibration.npz``: ``K`` (C, 3, 3), ``R`` (C, 3, 3),
``t`` (C, 3) camera from world, ``cams`` (C,) video ids. ``trc_reference.npz``: ``xyz_zup_m``
(F, J, 3) metres in that world, row = source frame number, ``names`` (J,). Frames correspond when
their numbers are equal, so the phase of a frame is its number. Lens distortion (below a pixel here)
is ignored.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Int

from imocap_core.io.npz import load_arrays, names, numbers
from imocap_core.io.pose2sim_files import CALIBRATION, REFERENCE
from imocap_core.io.truth import Truth, VideoTruth

# OpenPose's points of these names are on the surface, not at SMPL's joints of the same name.
SURFACE_POINTS = {"neck": "upper_neck", "head": "head_top"}


def read_pose2sim_truth(folder: Path, used_frames: Mapping[str, Int[np.ndarray, " _"]]) -> Truth:
    """Truth of the videos named in ``used_frames`` (id -> (T,) source frame numbers).

    Frames that the reference does not cover are NaN; a video without calibration has joints and
    phase, but no camera. ValueError names the file and the faulty field.
    """
    calibration, reference = load_arrays(folder / CALIBRATION), load_arrays(folder / REFERENCE)
    xyz_m = numbers(reference, "xyz_zup_m", ("F", "J", 3), folder / REFERENCE)
    joint_names = tuple(
        project_name(name) for name in names(reference, "names", xyz_m.shape[1], folder / REFERENCE)
    )
    file = folder / CALIBRATION
    R = numbers(calibration, "R", ("C", 3, 3), file)
    K = numbers(calibration, "K", (len(R), 3, 3), file)
    t = numbers(calibration, "t", (len(R), 3), file)
    cameras = {
        camera: (K[i], R[i], t[i])
        for i, camera in enumerate(names(calibration, "cams", len(R), file))
    }
    videos = {}
    for video, frames in used_frames.items():
        covered = (frames >= 0) & (frames < len(xyz_m))
        joints = np.full((len(frames), *xyz_m.shape[1:]), np.nan)
        joints[covered] = xyz_m[frames[covered]]
        K_R_t = cameras.get(video, (None, None, None))
        videos[video] = VideoTruth(joints, joint_names, *K_R_t, frames.astype(np.float64))
    return Truth(videos, float(len(xyz_m) - 1))


def project_name(marker: str) -> str:
    """A marker's name in this project: RBigToe -> right_big_toe, Head -> head_top."""
    side = {"R": "right_", "L": "left_"}.get(marker[:1], "") if marker[1:2].isupper() else ""
    words = re.findall(r"[A-Z][a-z0-9]*", marker[1:] if side else marker) or [marker]
    plain = "_".join(word.lower() for word in words)
    return SURFACE_POINTS.get(plain, plain) if not side else side + plain

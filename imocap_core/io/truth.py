"""True joints, cameras and phases, for scoring only: truth.npz, or a calibrated rig's files.

A calibrated rig's triangulation as truth: calibration.npz and trc_reference.npz. Both files stand
beside action.yaml and come from a Pose2Sim project: cameras that ran together, and a triangulation
of their detections. ``calibration.npz``: ``K`` (C, 3, 3), ``R`` (C, 3, 3), ``t`` (C, 3) camera from
world, ``cams`` (C,) video ids. ``trc_reference.npz``: ``xyz_zup_m`` (F, J, 3) metres in that world,
row = source frame number, ``names`` (J,). Frames correspond when their numbers are equal, so the
phase of a frame is its number. Lens distortion (below a pixel here) is ignored.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, Shaped

from imocap_core.files import CALIBRATION, REFERENCE
from imocap_core.io.npz import load_arrays, names, numbers, rows_for_frames


@dataclass(frozen=True)
class VideoTruth:
    """Truth of one video at its T used frames; None where the file has no such array.

    joints: metres, world. R, t: camera from world in the first used frame; R_frames: in each frame
    of a camera that turns about its centre. hands: OpenPose's points of the left and the right
    hand, metres, world.
    theta: SMPL's pose in the world, axis-angle radians, joint 0 about the pelvis; trans: metres, as
    in smplx; betas: shape coefficients.
    segments: rotations of rigid segments of a captured skeleton from a neutral stance (x left, y
    up, z forward) to the world; segment_joints: the SMPL joint whose segment each is.
    """

    joints: Float[np.ndarray, "T J 3"] | None
    joint_names: tuple[str, ...]
    K: Float[np.ndarray, "3 3"] | None
    R: Float[np.ndarray, "3 3"] | None
    t: Float[np.ndarray, "3"] | None
    phase: Float[np.ndarray, " T"] | None
    R_frames: Float[np.ndarray, "T 3 3"] | None = None
    hands: Float[np.ndarray, "T 2 21 3"] | None = None
    theta: Float[np.ndarray, "T 72"] | None = None
    trans: Float[np.ndarray, "T 3"] | None = None
    betas: Float[np.ndarray, " B"] | None = None
    segments: Float[np.ndarray, "T S 3 3"] | None = None
    segment_joints: tuple[str, ...] = ()


@dataclass(frozen=True)
class Truth:
    """``videos`` by id; frames of two videos correspond when their phases are equal, and sync
    errors are divided by ``phase_end``.

    model: name and digest of the body model of theta, trans and betas, as `model_text` writes them.
    """

    videos: dict[str, VideoTruth]
    phase_end: float | None
    model: str | None = None


def model_text(name: str, digest: str) -> str:
    """Which body model a truth's pose and shape belong to."""
    return f"{name} {digest}"


def read_truth(path: Path, used_frames: Mapping[str, Int[np.ndarray, " _"]]) -> Truth:
    """The truth of some videos (id -> (T,) used source frames); None where the file has none.

    ``joint_names`` may be given once, or per video as ``<id>/joint_names``. ``<id>/frames`` gives
    the source frame of each row; see `rows_for_frames` for files without. ``R`` and ``t`` are those
    of the first used frame, or of the first row when the file has ``R_frames``. ValueError names
    file, array, expected and got.
    """
    arrays = load_arrays(path)
    end = float(numbers(arrays, "phase_end", (), path)) if "phase_end" in arrays else None
    videos = {v: _video(arrays, v, used, path) for v, used in used_frames.items()}
    model = str(arrays["model"]) if "model" in arrays else None
    return Truth(videos, end, model)


def _video(
    arrays: dict[str, Shaped[np.ndarray, "..."]],
    video: str,
    used: Int[np.ndarray, " T"],
    path: Path,
) -> VideoTruth:
    def part(name: str, *shape: int | str) -> Float[np.ndarray, "..."] | None:
        key = f"{video}/{name}"
        return numbers(arrays, key, shape, path) if key in arrays else None

    def at_used(name: str, *shape: int | str) -> Float[np.ndarray, "T ..."] | None:
        array = part(name, "T", *shape)
        if array is None:
            return None
        return array[rows_for_frames(arrays, len(array), used, path, f"{video}/frames")]

    joints = at_used("joints", "J", 3)
    of_video = f"{video}/joint_names"
    array = of_video if of_video in arrays else "joint_names"
    joint_names = () if joints is None else names(arrays, array, joints.shape[1], path)
    segments = at_used("segments", "S", 3, 3)
    count = 0 if segments is None else segments.shape[1]
    segment_joints = names(arrays, "segment_joints", count, path) if count else ()
    R, t, R_frames = part("R", 3, 3), part("t", 3), at_used("R_frames", 3, 3)
    if R_frames is not None and R is not None:
        t = None if t is None else R_frames[0] @ R.T @ t  # the centre -R^T t stays
        R = R_frames[0]
    return VideoTruth(
        joints,
        joint_names,
        part("K", 3, 3),
        R,
        t,
        at_used("phase"),
        R_frames,
        at_used("hands", 2, 21, 3),
        at_used("theta", 72),
        at_used("trans", 3),
        part("betas", "B"),
        segments,
        segment_joints,
    )


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

"""`imocap export` as npz: our own form, and AMASS's of both generations.

npz: one file per video, sync.csv and cameras.json, in SMPL's own convention (global orientation
about the pelvis, trans as in smplx), metres, radians. `trans`, `poses`, `betas` and
`mocap_framerate` are named as in AMASS; there is no `gender`, so that readers of AMASS refuse the
file instead of putting its betas on another body. The same values give the same bytes.

amass (Mahmood et al., ICCV 2019): `<id>_poses.npz` is one of SMPL+H, as of 2019: `poses` (T, 156),
`trans`, `betas` (16,), `dmpls`, `gender`, `mocap_framerate`. `<id>_stageii.npz` is one of SMPL-X,
as of 2021: `poses` (T, 165), jaw and eyes between body and hands, `mocap_frame_rate`,
`mocap_time_length`, `surface_model_type`, and the parts of `poses` by name. Either has the other's
names too, where they mean the same. `<id>_smpl.npz` is of plain SMPL, as programs for robots read
it: `poses` (T, 72), `betas` (10,). `betas` are 0, the mean shape of whatever body a reader loads;
ours, of another body, are `imocap_betas`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, Real

from imocap_core.files import write_csv


@dataclass(frozen=True)
class ExportedHands:
    """Additional arrays of `<id>.npz` where keypoints have hands; left, right."""

    poses_smplh: Float[np.ndarray, "T 156"]  # axis-angle radians: 22 joints of the body, 15 a hand
    points: Float[np.ndarray, "T 2 21 3"]  # metres, OpenPose's points
    visible: Bool[np.ndarray, "T 2"]  # keypoints of the hand were used; in the file: hand_seen


@dataclass(frozen=True)
class CameraFrames:
    """Additional arrays of a camera that turns, zooms or moves: of every frame."""

    K: Float[np.ndarray, "T 3 3"]
    R: Float[np.ndarray, "T 3 3"]  # camera from world
    t: Float[np.ndarray, "T 3"]  # metres

    def arrays(self) -> dict[str, Float[np.ndarray, "T ..."]]:
        """By their names in files."""
        return {"K_frames": self.K, "R_frames": self.R, "t_frames": self.t}


@dataclass(frozen=True)
class ExportedVideo:
    """The arrays of `<id>.npz`, all in one world."""

    id: str
    poses: Float[np.ndarray, "T 72"]  # axis-angle radians
    betas: Float[np.ndarray, "10"]
    trans: Float[np.ndarray, "T 3"]  # metres
    joints: Float[np.ndarray, "T J 3"]  # metres; 24, or 52 with hands
    joint_names: tuple[str, ...]
    fps: float
    size: tuple[int, int]
    # source frame numbers, fractional on the common timeline
    frames: Int[np.ndarray, " T"] | Float[np.ndarray, " T"]
    K: Float[np.ndarray, "3 3"]
    R: Float[np.ndarray, "3 3"]  # camera from world
    t: Float[np.ndarray, "3"]  # metres
    model: str  # name and digest of the body model
    up_axis: str
    hands: ExportedHands | None = None
    inside: Bool[np.ndarray, " T"] | None = None  # on the common timeline: the video shows it
    phase_s: Float[np.ndarray, " T"] | None = None  # on the common timeline: reference seconds
    time_s: Float[np.ndarray, " T"] | None = None  # in a file of variable frame rate
    joint_sd_mm: Float[np.ndarray, "T 24"] | None = None  # where the stage uncertainty has run
    per_frame: CameraFrames | None = None  # K, R, t are those of the first frame
    distortion: Float[np.ndarray, " 5"] | None = None  # OpenCV's k1, k2, p1, p2, k3, of K


def write_video(folder: Path, video: ExportedVideo) -> Path:
    """Write folder/<id>.npz and return its path."""
    file = folder / f"{video.id}.npz"
    hands = video.hands
    more: dict[str, Any] = {
        "poses_smplh": None if hands is None else hands.poses_smplh,
        "hand_points": None if hands is None else hands.points,
        "hand_seen": None if hands is None else hands.visible,
        "inside": video.inside,
        "phase_s": video.phase_s,
        "time_s": video.time_s,
        "joint_sd_mm": video.joint_sd_mm,
        **({} if video.per_frame is None else video.per_frame.arrays()),
        "distortion": video.distortion,
    }
    np.savez(
        file,
        poses=video.poses,
        betas=video.betas,
        trans=video.trans,
        joints=video.joints,
        joint_names=np.array(video.joint_names),
        fps=np.float64(video.fps),
        mocap_framerate=np.float64(video.fps),
        frames=video.frames,
        K=video.K,
        R=video.R,
        t=video.t,
        model=np.array(video.model),
        up_axis=np.array(video.up_axis),
        **{name: array for name, array in more.items() if array is not None},
    )
    return file


def write_cameras(folder: Path, videos: list[ExportedVideo], reference: str) -> Path:
    """Write folder/cameras.json and return its path."""
    file = folder / "cameras.json"
    content = {
        "reference": reference,
        "convention": "x_cam = R x_world + t, metres; x right, y down, z forward; K in pixels",
        "up_axis": videos[0].up_axis,
        "cameras": {
            v.id: {
                "K": v.K.tolist(),
                "R": v.R.tolist(),
                "t": v.t.tolist(),
                "size": list(v.size),
                **({} if v.distortion is None else {"distortion": v.distortion.tolist()}),
                **(
                    {}
                    if v.per_frame is None
                    else {name: values.tolist() for name, values in v.per_frame.arrays().items()}
                ),
            }
            for v in videos
        },
    }
    file.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    return file


def write_sync(
    folder: Path,
    frames: Mapping[str, Real[np.ndarray, " _"]],
    maps: Mapping[str, tuple[Float[np.ndarray, " _"], Float[np.ndarray, " _"]]],
    reference: str,
    phases: Mapping[str, Float[np.ndarray, " _"]] | None = None,
) -> Path:
    """Write folder/sync.csv and return its path.

    Args:
        frames: per video, the source frame numbers (T,) of its used frames.
        maps: per video, the matched position (T,) in the reference's used frames (fractional index,
            NaN where unmatched) and the confidence (T,).
        reference: the video that the others are matched to; it gets no rows.
        phases: per video, its frames (T,) on the common time axis, seconds of the reference, NaN
            where unknown; the column phase_s.
    """
    file = folder / "sync.csv"
    positions = np.arange(len(frames[reference]), dtype=np.float64)
    rows = []
    for video, (index, confidence) in maps.items():
        if video == reference:
            continue
        matched = np.interp(index, positions, frames[reference])
        phase = np.full(len(index), np.nan) if phases is None else phases[video]
        for row in zip(frames[video], matched, confidence, phase, strict=True):
            number = float(row[0])
            frame = f"{number:.3f}".rstrip("0").rstrip(".") if number % 1 else f"{number:.0f}"
            numbers = zip(row[1:], (3, 3, 4), strict=True)
            rows.append([video, frame, *("" if np.isnan(x) else f"{x:.{d}f}" for x, d in numbers)])
    write_csv(file, ["video", "frame", "reference_frame", "confidence", "phase_s"], rows)
    return file


BODY, FACE, HANDS = 66, 9, 90  # numbers of 22 joints of the body, jaw and eyes, 2 x 15 fingers
BETAS, SMPL_BETAS, DMPLS = 16, 10, 8
BETAS_NOTE = (
    "0, the mean shape of the body that a reader loads; imocap_betas are those of imocap_model and "
    "mean other shapes on any other body"
)


def write_amass(folder: Path, video: ExportedVideo) -> list[Path]:
    """Write folder/<id>_poses.npz (SMPL+H) and folder/<id>_stageii.npz (SMPL-X), the archive's
    kinds of names, and folder/<id>_smpl.npz; return their paths."""
    smplh = np.concatenate([video.poses[:, :BODY], np.zeros((len(video.poses), HANDS))], axis=1)
    if video.hands is not None:
        smplh = video.hands.poses_smplh  # else the hands are flat
    body, hands = smplh[:, :BODY], smplh[:, BODY:]
    face = np.zeros((len(smplh), FACE))
    common = {
        "root_orient": body[:, :3],
        "pose_body": body[:, 3:],
        "pose_hand": hands,
        "trans": video.trans,
        "betas": np.zeros(BETAS),
        "num_betas": np.int64(BETAS),
        "gender": np.array("neutral"),
        "mocap_framerate": np.float64(video.fps),
        "mocap_frame_rate": np.float64(video.fps),
        "mocap_time_length": np.float64(len(smplh) / video.fps),
        **_of_ours(video),
    }
    of_smplh = {"poses": smplh, "surface_model_type": np.array("smplh")}
    of_smplh["dmpls"] = np.zeros((len(smplh), DMPLS))
    of_smplx = {
        "poses": np.concatenate([body, face, hands], axis=1),
        "pose_jaw": face[:, :3],
        "pose_eye": face[:, 3:],
        "surface_model_type": np.array("smplx"),
    }
    of_smpl = {
        "poses": video.poses,
        "pose_body": video.poses[:, 3:],
        "pose_hand": video.poses[:, BODY:],
        "betas": np.zeros(SMPL_BETAS),
        "num_betas": np.int64(SMPL_BETAS),
        "surface_model_type": np.array("smpl"),
    }
    files = []
    for ending, arrays in (("poses", of_smplh), ("stageii", of_smplx), ("smpl", of_smpl)):
        files.append(folder / f"{video.id}_{ending}.npz")
        np.savez(files[-1], **(common | arrays))
    return files


def _of_ours(video: ExportedVideo) -> dict[str, Any]:
    """What the archive has not: the camera, source frames, and our body's shape and joints."""
    ours: dict[str, Any] = {
        "frames": video.frames,
        "K": video.K,
        "R": video.R,
        "t": video.t,
        "up_axis": np.array(video.up_axis),
        "imocap_betas": video.betas,
        "imocap_model": np.array(video.model),
        "imocap_joints": video.joints,
        "imocap_joint_names": np.array(video.joint_names),
    }
    if video.per_frame is not None:
        ours |= video.per_frame.arrays()
    if video.inside is not None and video.phase_s is not None:
        ours |= {"inside": video.inside, "phase_s": video.phase_s}
    return ours

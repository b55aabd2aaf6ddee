"""`imocap export` as npz, our own form and AMASS's of both generations; cameras.json and sync.csv.

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
from pathlib import Path
from typing import Any

import numpy as np

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.files import write_csv
from imocap_core.result.result import ActionResult
from imocap_core.result.video import Synchronisation, VideoResult

Arrays = dict[str, Any]


def video_arrays(video: VideoResult, result: ActionResult) -> Arrays:
    """The arrays of `<id>.npz`: interfaces.md has their shapes, and docs/exports.md their meaning.

    frames are source frame numbers, fractional on the common timeline, where `inside` (T,) and
    `phase_s` (T,) are there too. Of videos with hands: `poses_smplh` (T, 156), `hand_points`
    (T, 2, 21, 3) metres, OpenPose's points, `hand_seen` (T, 2): keypoints of it were used. `time_s`
    (T,) in a file of variable frame rate. `joint_sd_mm` (T, 24) where the stage uncertainty has
    run. `distortion` (5,): OpenCV's k1, k2, p1, p2, k3, of K.
    """
    camera, hands, common = _camera_arrays(video), video.hands, result.time == "common"
    arrays = {
        "poses": video.theta,
        "betas": video.betas,
        "trans": video.trans,
        "joints": video.body_joints,
        "joint_names": np.array(SMPL_JOINTS),
        "fps": np.float64(video.fps),
        "mocap_framerate": np.float64(video.fps),
        "frames": video.frames,
        **{name: camera.pop(name) for name in "KRt"},
        "model": np.array(video.model),
        "up_axis": np.array(result.up_axis),
        "poses_smplh": None if hands is None else video.poses,
        "hand_points": None if hands is None else hands.points,
        "hand_seen": None if hands is None else hands.visible,
        "inside": video.inside if common else None,
        "phase_s": video.phase_s if common else None,
        "time_s": None if video.keypoints.moments is None else video.time_s,
        "joint_sd_mm": video.uncertainty,
        **camera,
    }
    return {name: array for name, array in arrays.items() if array is not None}


def _camera_arrays(video: VideoResult) -> Arrays:
    """K (3, 3), R (3, 3), t (3,) camera from world, metres, of the first frame; K_frames, R_frames
    and t_frames, of every frame, of a camera that turns, zooms or moves; a lens's distortion."""
    camera = video.camera
    arrays: Arrays = {"K": camera.K, "R": camera.R, "t": camera.t}
    if not camera.is_static:
        arrays |= {"K_frames": camera.K_per_frame, "R_frames": camera.R_per_frame}
        arrays |= {"t_frames": camera.t_per_frame}
    return arrays if camera.lens is None else arrays | {"distortion": camera.distortion}


def write_video(folder: Path, video: VideoResult, result: ActionResult) -> Path:
    """Write folder/<id>.npz and return its path."""
    file = folder / f"{video.id}.npz"
    np.savez(file, **video_arrays(video, result))
    return file


def write_cameras(folder: Path, result: ActionResult) -> Path:
    """Write folder/cameras.json and return its path."""
    file = folder / "cameras.json"
    content = {
        "reference": result.reference,
        "convention": "x_cam = R x_world + t, metres; x right, y down, z forward; K in pixels",
        "up_axis": result.up_axis,
        "cameras": {
            video.id: {
                **{name: array.tolist() for name, array in _camera_arrays(video).items()},
                "size": list(video.camera.size),
            }
            for video in result
        },
    }
    file.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    return file


def write_sync(folder: Path, sync: Synchronisation) -> Path:
    """Write folder/sync.csv and return its path: of every frame of every video but the reference
    the reference's frame, both source frame numbers, empty where unmatched, the confidence, and the
    place on the common time axis in seconds of the reference."""
    file, summary = folder / "sync.csv", sync.summary
    reference = sync.videos[summary.reference].frames
    rows = []
    for match in summary.maps:
        if match.id == summary.reference:
            continue
        index = match.reference_frame
        matched = np.interp(index, np.arange(len(reference), dtype=np.float64), reference)
        phase = summary.phases.get(match.id, np.full(len(index), np.nan))
        frames = sync.videos[match.id].frames
        for row in zip(frames, matched, match.confidence, phase, strict=True):
            number = float(row[0])
            frame = f"{number:.3f}".rstrip("0").rstrip(".") if number % 1 else f"{number:.0f}"
            numbers = zip(row[1:], (3, 3, 4), strict=True)
            of_row = ["" if np.isnan(x) else f"{x:.{d}f}" for x, d in numbers]
            rows.append([match.id, frame, *of_row])
    write_csv(file, ["video", "frame", "reference_frame", "confidence", "phase_s"], rows)
    return file


BODY, FACE, HANDS = 66, 9, 90  # numbers of 22 joints of the body, jaw and eyes, 2 x 15 fingers
BETAS, SMPL_BETAS, DMPLS = 16, 10, 8
BETAS_NOTE = (
    "0, the mean shape of the body that a reader loads; imocap_betas are those of imocap_model and "
    "mean other shapes on any other body"
)

# What the archive has not, besides our body's shape and joints.
_OF_OURS = ("frames", "K", "R", "t", "up_axis", "inside", "phase_s")
_OF_FRAMES = ("K_frames", "R_frames", "t_frames")


def write_amass(folder: Path, name: str, arrays: Arrays) -> list[Path]:
    """Write folder/<id>_poses.npz (SMPL+H) and folder/<id>_stageii.npz (SMPL-X), the archive's
    kinds of names, and folder/<id>_smpl.npz; return their paths. arrays: see `video_arrays`."""
    poses, fps = arrays["poses"], arrays["fps"]
    flat = np.concatenate([poses[:, :BODY], np.zeros((len(poses), HANDS))], axis=1)
    smplh = arrays.get("poses_smplh", flat)
    body, hands = smplh[:, :BODY], smplh[:, BODY:]
    face = np.zeros((len(smplh), FACE))
    common = {
        "root_orient": body[:, :3],
        "pose_body": body[:, 3:],
        "pose_hand": hands,
        "trans": arrays["trans"],
        "betas": np.zeros(BETAS),
        "num_betas": np.int64(BETAS),
        "gender": np.array("neutral"),
        "mocap_framerate": fps,
        "mocap_frame_rate": fps,
        "mocap_time_length": np.float64(len(smplh) / fps),
        **{n: arrays[n] for n in (*_OF_OURS, *_OF_FRAMES) if n in arrays},
        **{f"imocap_{n}": arrays[n] for n in ("betas", "model", "joints", "joint_names")},
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
        "poses": poses,
        "pose_body": poses[:, 3:],
        "pose_hand": poses[:, BODY:],
        "betas": np.zeros(SMPL_BETAS),
        "num_betas": np.int64(SMPL_BETAS),
        "surface_model_type": np.array("smpl"),
    }
    files = []
    for ending, differing in (("poses", of_smplh), ("stageii", of_smplx), ("smpl", of_smpl)):
        files.append(folder / f"{name}_{ending}.npz")
        np.savez(files[-1], **(common | differing))
    return files

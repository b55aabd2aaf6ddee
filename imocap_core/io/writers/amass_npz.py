"""`imocap export --format amass`: files as both generations of AMASS's archive have them.

`<id>_poses.npz` is one of SMPL+H, as of 2019: `poses` (T, 156), `trans`, `betas` (16,), `dmpls`,
`gender`, `mocap_framerate`. `<id>_stageii.npz` is one of SMPL-X, as of 2021: `poses` (T, 165),
jaw and eyes between body and hands, `mocap_frame_rate`, `mocap_time_length`, `surface_model_type`,
and the parts of `poses` by name. Either has the other's names too, as far as they mean the same.
`<id>_smpl.npz` is of plain SMPL, as programs for robots read it: `poses` (T, 72), `betas` (10,).

Readers put `betas` on whatever body they load and look at no model's name. Ours are of another
body, so `betas` are 0, the reader's mean shape, and ours are `imocap_betas`. Mahmood et al., ICCV
2019.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.io.writers.export_npz import ExportedVideo

BODY, FACE, HANDS = 66, 9, 90  # numbers of 22 joints of the body, jaw and eyes, 2 x 15 fingers
BETAS, SMPL_BETAS, DMPLS = 16, 10, 8
BETAS_NOTE = (
    "0, the mean shape of the body that a reader loads; imocap_betas are those of imocap_model and "
    "mean other shapes on any other body"
)


def write_amass(folder: Path, video: ExportedVideo) -> list[Path]:
    """Write folder/<id>_poses.npz (SMPL+H) and folder/<id>_stageii.npz (SMPL-X), the archive's
    kinds of names, and folder/<id>_smpl.npz; return their paths."""
    smplh = smplh_poses(video)
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


def smplh_poses(video: ExportedVideo) -> Float[np.ndarray, "T 156"]:
    """Axis-angle radians of SMPL+H's 52 joints; the hands are flat where the video has none."""
    if video.hands is not None:
        return video.hands.poses_smplh
    return np.concatenate([video.poses[:, :BODY], np.zeros((len(video.poses), HANDS))], axis=1)

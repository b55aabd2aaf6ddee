"""`imocap export --format amass`: one npz per video, as AMASS's files of the body SMPL+H are.

Names and shapes are those of both generations of the archive: `poses` (T, 156), `trans`, `betas`
(16,), `dmpls` (T, 8), `gender` and `mocap_framerate` of the first (`*_poses.npz`), and
`mocap_frame_rate`, `mocap_time_length`, `surface_model_type`, `root_orient`, `pose_body`,
`pose_hand` and `num_betas` of the second. Readers put `betas` on whatever body they load and look
at no model's name. Ours are of another body, so `betas` are 0, the reader's mean shape, and ours
are `imocap_betas`. Mahmood et al., ICCV 2019.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.io.writers.export_npz import ExportedVideo

BODY, HANDS = 66, 90  # numbers of 22 joints of the body and of 2 x 15 of the hands
BETAS, DMPLS = 16, 8
BETAS_NOTE = (
    "0, the mean shape of the body that a reader loads; imocap_betas are those of imocap_model and "
    "mean other shapes on any other body"
)


def write_amass(folder: Path, video: ExportedVideo) -> Path:
    """Write folder/<id>_poses.npz, the archive's kind of name, and return its path."""
    file = folder / f"{video.id}_poses.npz"
    poses = smplh_poses(video)
    more: dict[str, Any] = {} if video.per_frame is None else video.per_frame.arrays()
    if video.inside is not None and video.phase_s is not None:
        more |= {"inside": video.inside, "phase_s": video.phase_s}
    np.savez(
        file,
        poses=poses,
        root_orient=poses[:, :3],
        pose_body=poses[:, 3:BODY],
        pose_hand=poses[:, BODY:],
        trans=video.trans,
        betas=np.zeros(BETAS),
        num_betas=np.int64(BETAS),
        dmpls=np.zeros((len(poses), DMPLS)),
        gender=np.array("neutral"),
        surface_model_type=np.array("smplh"),
        mocap_framerate=np.float64(video.fps),
        mocap_frame_rate=np.float64(video.fps),
        mocap_time_length=np.float64(len(poses) / video.fps),
        frames=video.frames,
        K=video.K,
        R=video.R,
        t=video.t,
        up_axis=np.array(video.up_axis),
        imocap_betas=video.betas,
        imocap_model=np.array(video.model),
        imocap_joints=video.joints,
        imocap_joint_names=np.array(video.joint_names),
        **more,
    )
    return file


def smplh_poses(video: ExportedVideo) -> Float[np.ndarray, "T 156"]:
    """Axis-angle radians of SMPL+H's 52 joints; the hands are flat where the video has none."""
    if video.hands is not None:
        return video.hands.poses_smplh
    return np.concatenate([video.poses[:, :BODY], np.zeros((len(video.poses), HANDS))], axis=1)

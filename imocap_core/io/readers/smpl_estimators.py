"""Estimators of SMPL (VIBE, WHAM, TRAM, PHALP and others), and all estimators by name.

Used are joint rotations, the root's in camera axes, and what finds the performer among several
people; docs/formats.md names the files. Pickles, joblib's and torch's files are read by restricted
readers.

VIBE: {person: {``pose`` (N, 72) axis-angle, ``bboxes`` (N, 4) middle, width and height in pixels,
``frame_ids`` (N,)}}. WHAM: the same with ``trans`` (N, 3), projected with WHAM's default focal
length (the picture's diagonal), for boxes.

HMMR: ``poses`` (N, 24, 3, 3) rotation matrices. The file has no frame numbers: N is the number of
used frames, or of all frames of the video.

GVHMR, GEM: ``smpl_params_incam`` or ``body_params_incam`` with ``global_orient`` (N, 3) and
``body_pose`` (N, 63), axis-angle: pelvis and the 21 joints that SMPL-X shares with SMPL (SMPL's
hands stay at rest); one row per frame of the video.

TRAM: ``pred_rotmat`` (N, 24, 3, 3) and ``frame`` (N,); ``pred_trans`` (N, 1, 3) with ``img_focal``
and ``img_center``, which are optional, give the person's position. A folder stands for all its
tracks, a file for that person alone.

PromptHMR: ``people``: {track: {``frames`` (N,), ``bboxes`` (N, 4 or more) x0, y0, x1, y1 in pixels,
``smplx_cam``: {``pose`` (N, 165) axis-angle of SMPL-X's 55 joints}}}. The first 22 are SMPL's.

4D-Humans (HMR2) with PHALP: {picture's path: {``time`` the frame's number from 0,
``smpl`` for each {``global_orient`` (1, 3, 3), ``body_pose`` (23, 3, 3)}, ``bbox``
x, y, width, height in pixels, ``tracked_time`` frames since the person was last detected}}. People
who were not detected in a frame (``tracked_time`` above 0) are ignored there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int, Shaped

from imocap_core.conventions import JOINTS
from imocap_core.io.array_files import read_results
from imocap_core.io.npz import load_arrays, numbers, rows_for_frames
from imocap_core.io.readers import estimates
from imocap_core.io.readers.mediapipe import read_mediapipe_world
from imocap_core.io.readers.people import frame_number, listed, type_name


def _read_vibe(path: Path, performer: estimates.PerformerBoxes) -> Float[np.ndarray, "T 24 3 3"]:
    """The performer's joint rotations in camera axes; see `performer_of`."""
    return estimates.performer_of(
        path,
        performer,
        lambda person, n, where: estimates.field(person, "bboxes", (n, 4), where)[:, :2],
    )


def _read_wham(path: Path, performer: estimates.PerformerBoxes) -> Float[np.ndarray, "T 24 3 3"]:
    """The performer's joint rotations in camera axes; see `performer_of`."""

    def middle_px(person: dict[str, Any], count: int, where: str) -> Float[np.ndarray, "N 2"]:
        trans = estimates.field(person, "trans", (count, 3), where)
        focal_px = float(np.hypot(*performer.size))
        depth = np.where(trans[:, 2:] > 0, trans[:, 2:], np.nan)
        return np.asarray(focal_px * trans[:, :2] / depth + 0.5 * np.array(performer.size))

    return estimates.performer_of(path, performer, middle_px)


def _read_hmmr(path: Path, performer: estimates.PerformerBoxes) -> Float[np.ndarray, "T 24 3 3"]:
    """The joint rotations in camera axes. ValueError names file and field."""
    poses = estimates.field(read_results(path), "poses", ("N", JOINTS, 3, 3), str(path))
    rows = rows_for_frames({}, len(poses), performer.frames, path)
    return estimates.checked_rotations(poses[rows], f"{path}: poses")


GVHMR, GEM = "smpl_params_incam", "body_params_incam"
SMPL_BODY = 63


def _read_one_person(
    path: Path, performer: estimates.PerformerBoxes, group: str
) -> Float[np.ndarray, "T 24 3 3"]:
    """The joint rotations in camera axes. ValueError names file and field."""
    content = read_results(path)
    if not isinstance(content, dict) or group not in content:
        got = ", ".join(map(str, content)) if isinstance(content, dict) else type_name(content)
        raise ValueError(f"{path}: expected a dictionary with {group}, got {got:.80}")
    where = f"{path}: {group}"
    body = estimates.field(content[group], "body_pose", ("N", "D"), where)
    if body.shape[1] != SMPL_BODY:
        raise ValueError(
            f"{where}: body_pose: expected (N, {SMPL_BODY}) of SMPL, got {body.shape}; of another "
            "body model give joints (joints_npz)"
        )
    root = estimates.field(content[group], "global_orient", (len(body), 3), where)
    rows = rows_for_frames({}, len(body), performer.frames, path)
    return estimates.from_vectors(np.concatenate([root, body], axis=1)[rows])


def _read_tram(path: Path, performer: estimates.PerformerBoxes) -> Float[np.ndarray, "T 24 3 3"]:
    """The performer's joint rotations in camera axes, NaN where missing.

    ValueError names file, field, expected and got.
    """
    files = sorted(path.glob("hps_track_*.npy")) if path.is_dir() else [path]
    if not files:
        raise ValueError(f"{path}: expected hps_track_0.npy and so on in the folder, found none")
    tracks: list[estimates.Track] = []
    for file in files:
        content = read_results(file)
        rotations = estimates.field(content, "pred_rotmat", ("N", JOINTS, 3, 3), str(file))
        given = estimates.field(content, "frame", (len(rotations),), str(file))
        frames = estimates.frame_ids(given, f"{file}: frame")
        poses = estimates.checked_rotations(rotations, f"{file}: pred_rotmat")
        tracks.append((frames, _middle(content, len(rotations)), poses))
    return estimates.of_tracks(tracks, performer, path)


def _middle(content: Any, count: int) -> Float[np.ndarray, "N 2"] | None:
    """The person's position in pixels, or None when the file has none."""
    given = [content.get(name) for name in ("pred_trans", "img_focal", "img_center")]
    if any(value is None for value in given):
        return None
    trans, focal, center = (np.asarray(value) for value in given)
    if any(values.dtype.kind not in "fiu" for values in (trans, focal, center)):
        return None
    if trans.size != 3 * count or center.size < 2 or focal.size < 1:
        return None
    xyz = trans.astype(np.float64).reshape(count, 3)
    depth = np.where(xyz[:, 2:] > 0, xyz[:, 2:], np.nan)
    return float(focal.ravel()[0]) * xyz[:, :2] / depth + center.ravel()[:2]


BODY = 66  # pelvis and the 21 joints that SMPL, SMPL-H and SMPL-X share, three numbers each
SMPLX = 165
IN_CAMERA = "smplx_cam"


def _read_prompthmr(
    path: Path, performer: estimates.PerformerBoxes
) -> Float[np.ndarray, "T 24 3 3"]:
    """The performer's joint rotations in camera axes, NaN where missing.

    ValueError names file, person, field, expected and got.
    """
    content = read_results(path)
    people = content.get("people") if isinstance(content, dict) else content
    tracks: list[estimates.Track] = []
    for name, person in estimates.fields_of(people, path, "of people").items():
        where = f"{path}: people {name}"
        held = person if isinstance(person, dict) else {}
        pose = estimates.field(held.get(IN_CAMERA), "pose", ("N", SMPLX), f"{where}: {IN_CAMERA}")
        boxes = estimates.field(person, "bboxes", (len(pose), "4 or more"), where)
        if boxes.shape[1] < 4:
            raise ValueError(f"{where}: bboxes: expected x0, y0, x1, y1, got {boxes.shape}")
        frames = estimates.frame_ids(estimates.field(person, "frames", (len(pose),), where), where)
        middles = 0.5 * (boxes[:, :2] + boxes[:, 2:4])
        tracks.append((frames, middles, estimates.from_vectors(pose[:, :BODY])))
    return estimates.of_tracks(tracks, performer, path)


def _read_phalp(path: Path, performer: estimates.PerformerBoxes) -> Float[np.ndarray, "T 24 3 3"]:
    """The performer's joint rotations in camera axes, NaN where missing.

    ValueError names file, frame, field, expected and got.
    """
    content = estimates.fields_of(read_results(path), path, "with one entry per frame")
    frames, middle, poses = [], [], []
    for n, name in enumerate(sorted(content)):
        where, entry = f"{path}: {name}", content[name]
        fields: dict[str, Any] = {"tracked_time": []} | entry if isinstance(entry, dict) else {}
        people, boxes, since = (
            listed(fields.get(key), f"{where}: {key}", "a list of people")
            for key in ("smpl", "bbox", "tracked_time")
        )
        if len(people) != len(boxes):
            got = f"{len(people)} and {len(boxes)}"
            raise ValueError(f"{where}: expected as many smpl and bbox, got {got}")
        frame = frame_number(_number(entry.get("time", n)), f"{where}: time")
        for i, person in enumerate(people):
            if i < len(since) and since[i] != 0:
                continue
            box = estimates.field({"bbox": boxes[i]}, "bbox", (4,), f"{where}: person {i}")
            frames.append(frame)
            middle.append(box[:2] + 0.5 * box[2:])
            poses.append(_rotations(person, f"{where}: person {i}"))
    if not poses:
        raise ValueError(f"{path}: expected at least one person, got none; track the video again")
    rotations = estimates.checked_rotations(np.stack(poses), f"{path}: smpl")
    return estimates.of_tracks([(np.array(frames), np.array(middle), rotations)], performer, path)


def _rotations(person: Any, where: str) -> Float[np.ndarray, "24 3 3"]:
    root = estimates.field(person, "global_orient", (1, 3, 3), where)
    body = estimates.field(person, "body_pose", (JOINTS - 1, 3, 3), where)
    return np.concatenate([root, body])


def _number(value: Any) -> Any:
    """A numpy number as Python's."""
    return (
        value.item() if isinstance(value, (np.generic, np.ndarray)) and value.size == 1 else value
    )


@dataclass(frozen=True)
class SmplEstimate:
    """SMPL parameters in a world, and the camera from that world.

    theta: axis-angle, radians. trans: metres, as in smplx. R, t: identity and 0 when the file has
    none; its world is then the camera's axes.
    """

    theta: Float[np.ndarray, "T 72"]
    betas: Float[np.ndarray, "10"]
    trans: Float[np.ndarray, "T 3"]
    R: Float[np.ndarray, "3 3"]
    t: Float[np.ndarray, "3"]


def read_smpl_npz(path: Path, used_frames: Int[np.ndarray, " T"]) -> SmplEstimate:
    """The estimate at the used source frames.

    The file has ``poses`` (N, 72 or 156), ``trans`` (N, 3) and optionally ``betas`` (10,) or
    (N, 10), ``R``, ``t`` and ``frames`` (N,). The hands of 156 numbers are ignored: SMPL's hand
    joints are then at rest. Betas that change over time are averaged. ValueError names file, array,
    expected and got.
    """
    arrays = load_arrays(path)
    poses = numbers(arrays, "poses", ("T", "72 or 156"), path)
    if poses.shape[1] not in (72, 156):
        raise ValueError(f"{path}: poses: expected 72 or 156 columns, got {poses.shape[1]}")
    rows = rows_for_frames(arrays, len(poses), used_frames, path)
    trans = numbers(arrays, "trans", (len(poses), 3), path)
    theta = poses[rows, :72]
    if poses.shape[1] == 156:
        theta = theta.copy()
        theta[:, BODY:] = 0.0
    return SmplEstimate(
        theta,
        _betas(arrays, path),
        trans[rows],
        numbers(arrays, "R", (3, 3), path) if "R" in arrays else np.eye(3),
        numbers(arrays, "t", (3,), path) if "t" in arrays else np.zeros(3),
    )


def _betas(arrays: dict[str, Shaped[np.ndarray, "..."]], path: Path) -> Float[np.ndarray, "10"]:
    """Ten numbers: cut or filled with zeros, averaged over time."""
    if "betas" not in arrays:
        return np.zeros(10)
    per_frame = arrays["betas"].ndim == 2
    betas = numbers(arrays, "betas", ("T", "B") if per_frame else ("B",), path)
    mean = betas.mean(axis=0) if per_frame else betas
    return np.concatenate([mean[:10], np.zeros(max(0, 10 - len(mean)))])


# Joint rotations in camera axes, NaN where there is no estimate.
ROTATIONS: dict[str, Callable[[Path, estimates.PerformerBoxes], Float[np.ndarray, "T 24 3 3"]]] = {
    "hmr2": _read_phalp,
    "tokenhmr": _read_phalp,
    "wham": _read_wham,
    "gvhmr": partial(_read_one_person, group=GVHMR),
    "gem": partial(_read_one_person, group=GEM),
    "prompthmr": _read_prompthmr,
    "vibe": _read_vibe,
    "hmmr": _read_hmmr,
    "tram": _read_tram,
}
# Joints (T, J, 3) metres in camera axes.
JOINT_READERS: dict[str, Callable[[Path, estimates.PerformerBoxes], estimates.JointsEstimate]] = {
    "joints_npz": lambda path, performer: estimates.read_joints_npz(path, performer.frames),
    "sam3d_body": estimates.read_sam3d_body,
    "mediapipe_world": read_mediapipe_world,
}

"""Monocular 3D estimates: checked fields and the performer's rows, for every reader; 3D joints.

Of a monocular estimate the joint rotations (or the joints) are used, in camera axes (x right,
y down, z forward). Its translation is not: its depth depends on the focal length that each tool
assumes, so the body is placed by the keypoints.

Of 3D joints: joints_npz, and SAM 3D Body as its users saved it: a list with one entry per frame,
each a list of people, one person, or {``frame``: number, ``people``: list of people}; a person is a
dictionary with ``pred_keypoints_3d`` (70, 3) metres in camera axes, ``pred_keypoints_2d`` (70, 2)
pixels, ``bbox`` x0, y0, x1, y1 in pixels, and more. Or an npz with ``pred_keypoints_3d`` (T, 70, 3)
of one person and, optionally, ``frames`` (T,). The 70 points are MHR's; those that are joints of
SMPL are used by the fits. MHR's parameters are of its own body and not used: the joints' distances
tell the size.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from imocap_core.conventions import JOINTS
from imocap_core.io.array_files import read_results
from imocap_core.io.npz import are_numbers, load_arrays, names, numbers, rows_for_frames
from imocap_core.io.readers.people import LARGEST, frame_number, listed, read_json, short, type_name
from imocap_core.rotations import exp

REACH = 0.75  # of the larger side of the performer's box: further away it is somebody else
_TOLERANCE = 0.05  # of R Rᵀ - 1 of a rotation matrix


@dataclass(frozen=True)
class PerformerBoxes:
    """Where the keypoints have the performer: boxes x0 y0 x1 y1 at the used source frames, NaN
    where undetected, and the picture's size (width, height)."""

    frames: Int[np.ndarray, " T"]
    box_px: Float[np.ndarray, "T 4"]
    size: tuple[int, int]


Track = tuple[Int[np.ndarray, " N"], Float[np.ndarray, "N 2"] | None, Float[np.ndarray, "..."]]


def of_tracks(
    tracks: Sequence[Track], performer: PerformerBoxes, path: Path
) -> Float[np.ndarray, "T *rest"]:
    """The performer's values at the used frames, NaN where missing.

    Of several people in a frame the one nearest to the performer's box is used; without positions
    in the file, the track that is in most of the used frames.

    tracks: of each person the frames (N,), the middles in the picture (N, 2) or None, the values.
    ValueError when no used frame has an estimate.
    """
    each_frames, middles, each_values = zip(*tracks, strict=True)
    frames, values = np.concatenate(each_frames), np.concatenate(each_values)
    track = np.repeat(np.arange(len(tracks)), [len(each) for each in each_frames])
    used = {int(frame): row for row, frame in enumerate(performer.frames)}
    in_used = np.array([int(frame) in used for frame in frames], dtype=bool)
    keep = in_used
    if len(set(frames[in_used].tolist())) < int(in_used.sum()):
        if any(m is None for m in middles):
            numbers, counts = np.unique(track[in_used], return_counts=True)
            keep = in_used & (track == numbers[counts.argmax()])
        else:
            keep = in_used & _nearest(frames, np.concatenate(middles), performer, used)
    rows = np.full(len(performer.frames), -1, dtype=np.int64)
    for n in np.flatnonzero(keep):
        rows[used[int(frames[n])]] = n
    if (rows < 0).all():
        have = f"{frames.min()} to {frames.max()}" if len(frames) else "none"
        where = " at the performer's keypoints" if in_used.any() else ""
        first, last = performer.frames[0], performer.frames[-1]
        raise ValueError(
            f"{path}: expected an estimate in frames {first} to {last}{where}, got frames {have}; "
            "give the estimate of this video"
        )
    selected = values[np.maximum(rows, 0)].astype(np.float64)
    selected[rows < 0] = np.nan
    return selected


def _nearest(
    frames: Int[np.ndarray, " N"],
    middle_px: Float[np.ndarray, "N 2"],
    performer: PerformerBoxes,
    used: dict[int, int],
) -> Bool[np.ndarray, " N"]:
    """Which estimates are the nearest to the performer's box in their frames."""
    places = np.where(np.abs(middle_px) < LARGEST, middle_px, np.nan)
    best: dict[int, tuple[float, int]] = {}
    for n, frame in enumerate(frames):
        if int(frame) not in used:
            continue
        box = performer.box_px[used[int(frame)]]
        away = float(np.linalg.norm(places[n] - 0.5 * (box[:2] + box[2:])))
        reach = REACH * float(np.max(box[2:] - box[:2]))
        if away <= min(reach, best.get(int(frame), (np.inf, -1))[0]):  # NaN is never
            best[int(frame)] = (away, n)
    keep = np.zeros(len(frames), dtype=bool)
    keep[[n for _, n in best.values()]] = True
    return keep


def field(
    record: Any, name: str, shape: Sequence[int | str], where: str
) -> Float[np.ndarray, "..."]:
    """Numbers ``name`` of a dictionary, float64; ValueError unless their shape matches.

    Text in `shape` matches any length.
    """
    expected = "(" + ", ".join(map(str, shape)) + ")"
    if not isinstance(record, dict):
        raise ValueError(f"{where}: expected a dictionary with {name}, got {type_name(record)}")
    value = record.get(name)
    if isinstance(value, list):
        try:
            value = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            raise ValueError(f"{where}: {name}: expected numbers {expected}, got a list") from None
    if not isinstance(value, np.ndarray):
        have = ", ".join(map(str, record)) or "nothing"
        raise ValueError(
            f"{where}: {name}: expected numbers {expected}, got {type_name(value)}; has: {have:.80}"
        )
    if not are_numbers(value, shape):
        raise ValueError(
            f"{where}: {name}: expected numbers {expected}, got {value.dtype} {value.shape}"
        )
    return value.astype(np.float64)


def from_vectors(vectors: Float[np.ndarray, "N D"]) -> Float[np.ndarray, "N 24 3 3"]:
    """Joint rotations of axis-angle vectors (72 numbers or fewer); missing joints are at rest."""
    full = np.zeros((len(vectors), 3 * JOINTS))
    full[:, : vectors.shape[1]] = vectors
    return exp(torch.as_tensor(full.reshape(-1, JOINTS, 3))).numpy()


def checked_rotations(
    matrices: Float[np.ndarray, "N 24 3 3"], where: str
) -> Float[np.ndarray, "N 24 3 3"]:
    """The same matrices; ValueError unless they are rotations (or NaN)."""
    bounded = np.where(np.abs(matrices) < 2, matrices, 2.0)  # not a rotation, but finite
    bounded[np.isnan(matrices).any(axis=(-1, -2))] = np.eye(3)
    off = np.abs(bounded @ np.swapaxes(bounded, -1, -2) - np.eye(3)).max(axis=(-1, -2))
    wrong = (off > _TOLERANCE) | (np.linalg.det(bounded) < 0)
    if wrong.any():
        n, joint = np.argwhere(wrong)[0]
        raise ValueError(
            f"{where}: expected rotation matrices, got something else in row {n}, joint {joint}"
        )
    return matrices


def frame_ids(values: Float[np.ndarray, " N"], where: str) -> Int[np.ndarray, " N"]:
    """Frame numbers as integers; ValueError unless all are whole and at least 0."""
    if not (np.isfinite(values).all() and (values >= 0).all() and (values % 1 == 0).all()):
        raise ValueError(f"{where}: expected frame numbers from 0, got {short(values)}")
    return values.astype(np.int64)


MiddleOf = Callable[
    [dict[str, Any], int, str], Float[np.ndarray, "N 2"]
]  # person, number of frames, place in the file -> middle in pixels


def performer_of(
    path: Path, performer: PerformerBoxes, middle_px: MiddleOf
) -> Float[np.ndarray, "T 24 3 3"]:
    """The performer's joint rotations in camera axes, NaN where missing, of VIBE and WHAM.

    ValueError names file, person, field, expected and got.
    """
    tracks: list[Track] = []
    for name, person in fields_of(read_results(path), path, "of people").items():
        where = f"{path}: person {name}"
        pose = field(person, "pose", ("N", 72), where)
        middle = middle_px(person, len(pose), where)
        frames = frame_ids(field(person, "frame_ids", (len(pose),), where), where)
        tracks.append((frames, middle, pose))
    return from_vectors(of_tracks(tracks, performer, path))


def fields_of(content: Any, path: Path, what: str) -> dict[str, Any]:
    """A dictionary, with keys as text. ValueError for other content."""
    if not isinstance(content, dict) or not content:
        got = "an empty one" if isinstance(content, dict) else type_name(content)
        raise ValueError(f"{path}: expected a dictionary {what}, got {got}")
    return {str(name): fields for name, fields in content.items()}


@dataclass(frozen=True)
class JointsEstimate:
    """Joints in metres, camera axes, root-relative or not; NaN where missing."""

    joints: Float[np.ndarray, "T J 3"]
    joint_names: tuple[str, ...]


def read_joints_npz(path: Path, used_frames: Int[np.ndarray, " T"]) -> JointsEstimate:
    """The estimate at the used source frames.

    The file has ``joints`` (N, J, 3), ``joint_names`` (J,) and, optionally, ``frames`` (N,);
    see `rows_for_frames` for files without. ValueError names file, array, expected and got.
    """
    arrays = load_arrays(path)
    joints = numbers(arrays, "joints", ("T", "J", 3), path)
    joint_names = names(arrays, "joint_names", joints.shape[1], path)
    rows = rows_for_frames(arrays, len(joints), used_frames, path)
    return JointsEstimate(joints[rows], joint_names)


POINTS_3D, POINTS_2D = "pred_keypoints_3d", "pred_keypoints_2d"


def _hand(side: str) -> tuple[str, ...]:
    """MHR's 20 points of a hand, tips first, under SMPL+H's names, and the wrist."""
    fingers = ("thumb", "index", "middle", "ring", "pinky")
    points = [f"{side}_{f}{n}" for f in fingers for n in ("_tip", 3, 2, 1)]
    return (*points, f"{side}_wrist")


# MHR's 70 keypoints in their order, named as in this project where it has them.
NAMES: tuple[str, ...] = (
    *("nose", "left_eye", "right_eye", "left_ear", "right_ear"),
    *("left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_hip", "right_hip"),
    *("left_knee", "right_knee", "left_ankle", "right_ankle"),
    *("left_big_toe", "left_small_toe", "left_heel"),
    *("right_big_toe", "right_small_toe", "right_heel"),
    *_hand("right"),
    *_hand("left"),
    *("left_olecranon", "right_olecranon", "left_cubital_fossa", "right_cubital_fossa"),
    *("left_acromion", "right_acromion", "neck"),
)


def saved_people(path: Path) -> Iterator[tuple[int, list[tuple[dict[str, Any], str]]]]:
    """Per frame its number, and its people with their places in the file.

    ValueError names file, frame, expected and got.
    """
    content = read_json(path) if path.suffix == ".json" else read_results(path)
    entries = listed(content, path, "a list with one entry per frame")
    if not entries:
        raise ValueError(f"{path}: expected a list with one entry per frame, got an empty one")
    for n, entry in enumerate(entries):
        where, frame, people = f"{path}: [{n}]", n, entry
        if isinstance(entry, dict) and not {POINTS_3D, POINTS_2D} & set(entry):
            frame = frame_number(entry.get("frame", n), f"{where}: frame")
            people = entry.get("people")
        elif isinstance(entry, dict):
            people = [entry]
        people = listed(people, where, f"a list of people with {POINTS_3D}")
        if not all(isinstance(p, dict) for p in people):
            raise ValueError(f"{where}: expected a list of people with {POINTS_3D}, got a list")
        yield frame, [(person, f"{where}[{i}]") for i, person in enumerate(people)]


def read_sam3d_body(path: Path, performer: PerformerBoxes) -> JointsEstimate:
    """The performer's 70 points at the used frames, metres, camera axes, NaN where missing.

    ValueError names file, frame, field, expected and got.
    """
    if path.suffix == ".npz":
        arrays = load_arrays(path)
        table = numbers(arrays, POINTS_3D, ("T", len(NAMES), 3), path)
        rows = rows_for_frames(arrays, len(table), performer.frames, path)
        return JointsEstimate(table[rows], NAMES)
    frames, middles, joints = [], [], []
    for frame, people in saved_people(path):
        for person, where in people:
            box = np.full(4, np.nan)
            if person.get("bbox") is not None:
                box = field(person, "bbox", (4,), where)
            frames.append(frame)
            middles.append(0.5 * (box[:2] + box[2:]))
            joints.append(field(person, POINTS_3D, (len(NAMES), 3), where))
    if not frames:
        raise ValueError(f"{path}: expected at least one person, got none; run it again")
    places = np.array(middles) if np.isfinite(middles).all() else None
    tracks = [(np.array(frames, dtype=np.int64), places, np.stack(joints))]
    return JointsEstimate(of_tracks(tracks, performer, path), NAMES)

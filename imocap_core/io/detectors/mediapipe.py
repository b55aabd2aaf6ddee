"""MediaPipe Pose: its 33 landmarks of one clip, saved as JSON or npz.

MediaPipe returns landmarks and leaves saving to its user. Accepted: a JSON list (or ``frames``:
list) with one entry per frame, in the names of its results: ``pose_landmarks`` (or ``landmarks``,
``poseLandmarks``) and ``pose_world_landmarks`` (``world_landmarks``, ``worldLandmarks``), each a
list of 33 {x, y, z, visibility}, or a list of people with such a list each (as its newer tasks
return); ``frame`` is the frame number, without which frames count from 0. Or an npz with arrays
of these names (T, 33, 3 to 5: x, y, z, visibility), of several people (T, P, 33, 3 to 5), and,
optionally, ``frames`` (T,). Or a CSV of the picture's landmarks (`mediapipe_csv`).

As its guide says, landmarks are shares of the picture's width and height (numbers well above 1 are
taken as pixels), world landmarks are metres from the middle of the hips, x to the right, y down, z
away from the camera. z of picture landmarks and presence are not used.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from imocap_core.body.layouts import layout_names
from imocap_core.io.detectors.mediapipe_csv import landmarks_of_csv
from imocap_core.io.detectors.people import (
    LARGEST,
    DetectedPeople,
    cleaned,
    detections,
    frame_number,
    read_json,
    short,
    type_name,
)
from imocap_core.io.estimators.estimates import Entries, PerformerBoxes, performer_rows, select_rows
from imocap_core.io.estimators.joints_npz import JointsEstimate
from imocap_core.io.npz import load_arrays, numbers

Landmarks = Float[np.ndarray, "33 4"]  # x, y, z, visibility

LAYOUT, HEAVY_LAYOUT = "mediapipe33", "blazepose33"  # the same points, marked at other places
PICTURE = ("pose_landmarks", "landmarks", "poseLandmarks")
WORLD = ("pose_world_landmarks", "world_landmarks", "poseWorldLandmarks", "worldLandmarks")
ONLY_WORLD = (
    "has MediaPipe's world landmarks, in metres, and no places in the picture: save pose_landmarks "
    "beside them (the same file may then be `initial`, with initial_format: mediapipe_world)"
)
POINTS = 33
NORMALISED = 3.0  # shares of the picture stay below this, even for people half outside it


def read_mediapipe(path: Path, layout: str, size: tuple[int, int]) -> DetectedPeople:
    """All people of all frames, pixels of a picture of `size` (width, height).

    ValueError names file, field, expected and got.
    """
    if layout not in (LAYOUT, HEAVY_LAYOUT):
        raise ValueError(
            f"{path}: layout: expected {LAYOUT}, or {HEAVY_LAYOUT} of BlazePose heavy, got "
            f"{layout!r}; correct `layout` in action.yaml"
        )
    people = {
        frame: [cleaned(person[:, [0, 1, 3]]) for person in in_frame]
        for frame, in_frame in _in_pixels(path, size).items()
    }
    return detections(people, layout, path)


def read_mediapipe_world(path: Path, performer: PerformerBoxes) -> JointsEstimate:
    """World landmarks at the used frames as 3D joints, metres in camera axes.

    Frames without them are NaN; of several people the performer is found by the picture landmarks.
    ValueError names file, field, expected and got, or says that no used frame has a person.
    """
    people = dict(_frames(path, WORLD))
    persons = [(frame, n, person) for frame, ps in people.items() for n, person in enumerate(ps)]
    if not persons:
        raise ValueError(f"{path}: {WORLD[0]}: expected a person in some frame, got none")
    places = None
    if any(len(in_frame) > 1 for in_frame in people.values()):
        pixels = _in_pixels(path, performer.size)
        if all(len(pixels.get(frame, ())) == len(ps) for frame, ps in people.items()):
            places = np.array(
                [np.nanmean(pixels[frame][n][:, :2], axis=0) for frame, n, _ in persons]
            )
    frames, track = (np.array([entry[i] for entry in persons]) for i in (0, 1))
    rows = performer_rows(Entries(frames, track, places), performer, path)
    joints = select_rows(np.stack([person[:, :3] for _, _, person in persons]), rows)
    return JointsEstimate(joints, layout_names(LAYOUT))


def _in_pixels(path: Path, size: tuple[int, int]) -> dict[int, list[Landmarks]]:
    """Frame -> people, x and y in pixels of a picture of `size`."""
    people = dict(_frames(path, PICTURE))
    every = [person[:, :2] for in_frame in people.values() for person in in_frame]
    sizes = np.abs(np.concatenate(every)) if every else np.zeros((0, 2))
    sizes = sizes[np.isfinite(sizes)]
    if len(sizes) and np.median(sizes) < NORMALISED:
        for in_frame in people.values():
            for person in in_frame:
                person[:, :2] = np.where(np.abs(person[:, :2]) < LARGEST, person[:, :2], np.nan)
                person[:, :2] *= size
    return people


def _frames(path: Path, names: tuple[str, ...]) -> Iterator[tuple[int, list[Landmarks]]]:
    """(frame number, people)."""
    if path.suffix == ".npz":
        yield from _frames_of_npz(path, names)
        return
    if path.suffix.lower() == ".csv":
        if names is WORLD:
            raise ValueError(f"{path}: expected JSON or npz with {WORLD[0]}, got a CSV")
        for number, landmarks in landmarks_of_csv(path).items():
            yield number, [landmarks] if np.isfinite(landmarks[:, :2]).any() else []
        return
    content = read_json(path)
    listed = content.get("frames") if isinstance(content, dict) else content
    if not isinstance(listed, list) or not listed:
        got = "an empty list" if listed == [] else type_name(listed)
        raise ValueError(f"{path}: frames: expected a list with one entry per frame, got {got}")
    for i, entry in enumerate(listed):
        where = f"{path}: [{i}]"
        if entry is None:
            continue
        if not isinstance(entry, dict):
            raise ValueError(f"{where}: expected one frame's fields, got {type_name(entry)}")
        number = next((entry[n] for n in ("frame", "frame_id", "frame_index") if n in entry), i)
        name = next((n for n in names if n in entry), None)
        if name is None and names is PICTURE and set(WORLD) & set(entry):
            raise ValueError(f"{where}: {ONLY_WORLD}")
        if name is None:
            have = ", ".join(map(str, entry)) or "nothing"
            raise ValueError(f"{where}: expected {names[0]}, it is missing; has: {have:.60}")
        yield frame_number(number, where), list(_people(entry[name], f"{where}.{name}"))


def _people(listed: Any, where: str) -> Iterator[Landmarks]:
    if listed is None or listed == []:
        return
    if isinstance(listed, dict):  # protobuf's JSON
        listed = listed.get("landmark")
    if not isinstance(listed, list):
        raise ValueError(f"{where}: expected a list of {POINTS} landmarks, got {type_name(listed)}")
    if listed and all(isinstance(item, list) and len(item) == POINTS for item in listed):
        for n, person in enumerate(listed):
            yield _person(person, f"{where}[{n}]")
    else:
        yield _person(listed, where)


def _person(landmarks: list[Any], where: str) -> Landmarks:
    if len(landmarks) != POINTS:
        raise ValueError(f"{where}: expected {POINTS} landmarks, got {len(landmarks)}")
    rows = [
        [p.get("x"), p.get("y"), p.get("z", 0.0), p.get("visibility", 1.0)]
        if isinstance(p, dict)
        else ([*p[:3], p[3] if len(p) > 3 else 1.0] if isinstance(p, list) else p)
        for p in landmarks
    ]
    try:
        table = np.array(rows, dtype=np.float64)
        return table.reshape(POINTS, 4)
    except (TypeError, ValueError):
        raise ValueError(
            f"{where}: expected x, y, z, visibility of {POINTS} landmarks, got {short(rows[0])}"
        ) from None


def _frames_of_npz(path: Path, names: tuple[str, ...]) -> Iterator[tuple[int, list[Landmarks]]]:
    arrays = load_arrays(path)
    name = next((n for n in names if n in arrays), names[0])
    if names is PICTURE and name not in arrays and set(WORLD) & set(arrays):
        raise ValueError(f"{path}: {ONLY_WORLD}")
    several = name in arrays and arrays[name].ndim == 4
    dims = ("T", "P", POINTS, "3 to 5") if several else ("T", POINTS, "3 to 5")
    table = numbers(arrays, name, dims, path)
    if not 3 <= table.shape[-1] <= 5:
        raise ValueError(f"{path}: {name}: expected 3 to 5 numbers, got {table.shape[-1]}")
    if table.shape[-1] == 3:
        table = np.concatenate([table, np.ones((*table.shape[:-1], 1))], axis=-1)
    table = table if several else table[:, None]
    rows = np.arange(len(table))
    frames = numbers(arrays, "frames", (len(table),), path) if "frames" in arrays else rows
    for frame, people in zip(frames, table, strict=True):
        present = np.isfinite(people).any(axis=(1, 2))
        yield int(frame), [person[:, :4].copy() for person in people[present]]

"""MediaPipe: 33 landmarks as JSON, npz or CSV, and Holistic's hands.

MediaPipe Pose: its 33 landmarks of one clip, saved as JSON or npz.

MediaPipe returns landmarks and leaves saving to its user. Accepted: a JSON list (or ``frames``:
list) with one entry per frame, in the names of its results: ``pose_landmarks`` (or ``landmarks``,
``poseLandmarks``) and ``pose_world_landmarks`` (``world_landmarks``, ``worldLandmarks``), each a
list of 33 {x, y, z, visibility}, or a list of people with such a list each (as its newer tasks
return); ``frame`` is the frame number, without which frames count from 0. An entry may also be such
a list itself. Or an npz with arrays
of these names (T, 33, 3 to 5: x, y, z, visibility), of several people (T, P, 33, 3 to 5), and,
optionally, ``frames`` (T,). Or a CSV of the picture's landmarks (`mediapipe_csv`).

As its guide says, landmarks are shares of the picture's width and height (numbers well above 1 are
taken as pixels), world landmarks are metres from the middle of the hips, x to the right, y down, z
away from the camera. z of picture landmarks and presence are not used.

MediaPipe's landmarks in a CSV, as its users save them: one row a frame, with columns ``x0, y0, z0,
v0, ...`` (from 0 or 1), ``landmark_0_x``, or names as ``left_knee_x``, ``LEFT_KNEE_Y``. A column
with the frame's number is used where there is one.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from imocap_core.body.layouts import layout_names
from imocap_core.io.npz import array_names, load_arrays, numbers
from imocap_core.io.readers.estimates import JointsEstimate, PerformerBoxes, Track, of_tracks
from imocap_core.io.readers.people import (
    LARGEST,
    LAYOUT_OF_COUNT,
    TABLES,
    DetectedPeople,
    best_layout,
    cell_number,
    cleaned,
    columns_of,
    detections,
    frame_number,
    listed,
    must_be_whole,
    plain_name,
    read_csv,
    read_json,
    short,
    type_name,
)

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
    most = max(map(len, people.values()), default=0)
    if most == 0:
        raise ValueError(f"{path}: {WORLD[0]}: expected a person in some frame, got none")
    pixels = _in_pixels(path, performer.size) if most > 1 else {}
    placed = all(len(pixels.get(frame, ())) == len(ps) for frame, ps in people.items())
    tracks: list[Track] = []
    for n in range(most):
        of = [frame for frame, in_frame in people.items() if len(in_frame) > n]
        places = [np.nanmean(pixels[frame][n][:, :2], axis=0) for frame in of if placed]
        joints = np.stack([people[frame][n][:, :3] for frame in of])
        tracks.append((np.array(of), np.array(places) if placed else None, joints))
    return JointsEstimate(of_tracks(tracks, performer, path), layout_names(LAYOUT))


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
    if path.suffix.lower() == ".npz":
        yield from _frames_of_npz(path, names)
        return
    if path.suffix.lower() in TABLES:
        if names is WORLD:
            raise ValueError(f"{path}: expected JSON or npz with {WORLD[0]}, got a CSV")
        for number, landmarks in _landmarks_of_csv(path).items():
            yield number, [landmarks] if np.isfinite(landmarks[:, :2]).any() else []
        return
    content = read_json(path)
    entries = content.get("frames") if isinstance(content, dict) else content
    if not isinstance(entries, list) or not entries:
        got = "an empty list" if entries == [] else type_name(entries)
        raise ValueError(f"{path}: frames: expected a list with one entry per frame, got {got}")
    for i, entry in enumerate(entries):
        where = f"{path}: [{i}]"
        if entry is None:
            continue
        entry = {PICTURE[0]: entry} if isinstance(entry, list) else entry
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


def is_landmarks(person: Any) -> bool:
    """Whether an entry is the list of a person's landmarks."""
    return (
        isinstance(person, list)
        and len(person) == POINTS
        and all(isinstance(p, dict) and {"x", "y"} <= set(p) for p in person)
    )


def _people(content: Any, where: str) -> Iterator[Landmarks]:
    if content is None or content == []:
        return
    content = content.get("landmark") if isinstance(content, dict) else content  # protobuf's JSON
    people = listed(content, where, f"a list of {POINTS} landmarks")
    if people and all(isinstance(item, list) and len(item) == POINTS for item in people):
        for n, person in enumerate(people):
            yield _person(person, f"{where}[{n}]")
    else:
        yield _person(people, where)


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


FRAME = ("frame", "frame_id", "frame_index", "frame_idx", "frame_number", "frame_num", "frame_no")
AXES = {"x": 0, "y": 1, "z": 2} | dict.fromkeys(
    ("v", "vis", "visibility", "score", "c", "conf", "confidence", "likelihood"), 3
)
_AXIS = "|".join(sorted(AXES, key=len, reverse=True))
_AXIS_FIRST = re.compile(rf"({_AXIS})[_ .]?(\d+)")
_AXIS_LAST = re.compile(rf"(.*?)[_ .]({_AXIS})")


def landmark_columns(heading: Sequence[str]) -> dict[tuple[int, int], int] | None:
    """(landmark, axis) -> column, of a heading with one row a frame; None for another heading."""
    matches = _cells(heading)
    places = _landmarks([name for name, _, _ in matches])
    columns = {(places[n], axis): column for n, axis, column in matches if n in places}
    both = [k for k in range(POINTS) if (k, 0) in columns and (k, 1) in columns]
    return columns if len(both) >= POINTS // 2 else None


def _cells(heading: Sequence[str]) -> list[tuple[str, int, int]]:
    """(point, axis, column) of the cells of a heading that name a point's coordinate."""
    matches: list[tuple[str, int, int]] = []
    for column, cell in enumerate(heading):
        cell = cell.strip().lower()
        if match := _AXIS_FIRST.fullmatch(cell):
            matches.append((match[2], AXES[match[1]], column))
        elif match := _AXIS_LAST.fullmatch(cell):
            matches.append((match[1], AXES[match[2]], column))
    return matches


def points_of_csv(path: Path) -> tuple[dict[str, Float[np.ndarray, "..."]], str | None] | None:
    """Points of another layout, from a CSV with a row a frame: the arrays keypoints (T, K, 3) and
    frames (T,), and the layout where names tell it; None for a CSV of MediaPipe's or of others.

    As many numbered points as the layout has, or points with the names of its parts.
    """
    heading, *rows = read_csv(path)
    cells = _cells(heading)
    layout, places = _other_layout(cells)
    if not places:
        return None
    count = len(places) if layout is None else len(layout_names(layout))
    table = np.full((len(rows), count, 3), np.nan)
    table[..., 2] = 1.0
    frames = np.arange(len(rows))
    for n, (frame, row, where) in enumerate(_numbered_rows(path)):
        frames[n] = frame
        for name, axis, column in cells:
            if axis != AXES["z"] and name in places:
                table[n, places[name], min(axis, 2)] = cell_number(row[column], where)
    return {"keypoints": table, "frames": frames}, layout


def _numbered_rows(path: Path) -> Iterator[tuple[int, list[str], str]]:
    """(frame number, cells, place) of the rows of a CSV with a heading and a row a frame."""
    heading, *rows = read_csv(path)
    names = [cell.strip().lower() for cell in heading]
    column = next((names.index(name) for name in FRAME if name in names), None)
    for n, row in enumerate(rows):
        where = f"{path}: row {n + 2}"
        must_be_whole(row, len(heading), where)
        yield (
            n if column is None else frame_number(cell_number(row[column], where), where),
            row,
            where,
        )


def _other_layout(cells: Sequence[tuple[str, int, int]]) -> tuple[str | None, dict[str, int]]:
    """The layout where names tell it, and the place of each point's name; none for MediaPipe's."""
    names = list(dict.fromkeys(name for name, axis, _ in cells if axis == 0))
    digits = {name: int(m[0]) for name in names if (m := re.search(r"\d{1,4}$", name))}
    first = min(digits.values(), default=0)
    if len(names) == len(digits) and len(names) != POINTS and len(names) in LAYOUT_OF_COUNT:
        places = {name: n - first for name, n in digits.items()}
        return None, places if sorted(places.values()) == list(range(len(names))) else {}
    layout = best_layout(names)
    if layout in (None, LAYOUT) or any(axis == AXES["z"] for _, axis, _ in cells):
        return None, {}
    return layout, {names[n]: column for column, n in columns_of(names, layout).items()}


def _landmarks_of_csv(path: Path) -> dict[int, Float[np.ndarray, "33 4"]]:
    """Frame -> x, y, z, visibility. ValueError names file, row, expected and got."""
    heading = read_csv(path)[0]
    columns = landmark_columns(heading)
    if columns is None:
        cells = [cell.strip().lower() for cell in heading]
        raise ValueError(
            f"{path}: expected columns x, y and visibility of MediaPipe's {POINTS} landmarks, got "
            f"{', '.join(cells):.80}"
        )
    frames = {}
    for number, row, where in _numbered_rows(path):
        frames[number] = np.full((POINTS, 4), (np.nan, np.nan, 0.0, 1.0))
        for (landmark, axis), column in columns.items():
            frames[number][landmark, axis] = cell_number(row[column], where)
    return frames


def _landmarks(names: Sequence[str]) -> Mapping[str, int]:
    """Landmark of each name: a number, from 0 or 1, or a part of the body."""
    digits = {n: re.findall(r"\d+", n)[-1] for n in names if re.search(r"\d+$", n.strip())}
    numbers = {name: int(d) for name, d in digits.items() if len(d) < 3}
    first = 1 if numbers and min(numbers.values()) >= 1 and POINTS in numbers.values() else 0
    of_others = len(digits) != POINTS and len(digits) in LAYOUT_OF_COUNT
    many = len(set(numbers.values())) >= POINTS // 2 and POINTS - 1 + first in numbers.values()
    if many and not of_others:
        return {name: n - first for name, n in numbers.items() if 0 <= n - first < POINTS}
    places = {plain_name(name): k for k, name in enumerate(layout_names("mediapipe33"))}
    return {name: places[plain_name(name)] for name in names if plain_name(name) in places}


FIELDS = ("left_hand_landmarks", "right_hand_landmarks")
HAND_POINTS = 21


def read_mediapipe_hands(
    path: Path, frames: Int[np.ndarray, " T"], size: tuple[int, int]
) -> tuple[Float[np.ndarray, "T 2 21 2"], Float[np.ndarray, "T 2 21"]] | None:
    """The hands of the one person that MediaPipe tracks.

    Args:
        path: the file that `read_mediapipe` read; only an npz has hands: arrays (N, 21, 3), x and
            y as shares of the picture, beside `frames` (N,).
        frames: the used source frame numbers.
        size: width and height of the picture.

    Returns:
        Pixels and confidence, left hand first; NaN and 0 where a point is missing. MediaPipe gives
        no confidence of a hand's points: 1 where there is one. None when the file has no hands.

    Raises:
        ValueError: file, field, expected, got.
    """
    if path.suffix.lower() != ".npz" or not set(FIELDS) & array_names(path):
        return None
    arrays = load_arrays(path)
    xy_px = np.full((len(frames), 2, HAND_POINTS, 2), np.nan)
    for side, name in enumerate(FIELDS):
        if name not in arrays:
            continue
        table = numbers(arrays, name, ("T", HAND_POINTS, 3), path)
        rows = np.arange(len(table))
        numbered = numbers(arrays, "frames", (len(table),), path) if "frames" in arrays else rows
        row_of = {int(frame): row for row, frame in enumerate(numbered)}
        for t, frame in enumerate(frames.tolist()):
            if frame in row_of:
                xy_px[t, side] = table[row_of[frame], :, :2] * size
    visible = np.isfinite(xy_px).all(axis=-1)
    if not visible.any():
        return None
    return np.where(visible[..., None], xy_px, np.nan), visible.astype(np.float64)

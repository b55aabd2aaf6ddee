"""C3D, the file of motion laboratories (c3d.org): markers, joint angles and events.

The parameter section of a C3D file (c3d.org): groups of named, typed arrays. Little-endian
("Intel") throughout. Names and group names are upper case, at most 127 characters; a dimension is
at most 255, so that longer lists of labels continue in LABELS2, LABELS3.

Coordinates are 32-bit floats. A point's fourth number has its residual, here the standard deviation
of the place (0 where none is known), and is -1 where the point is missing.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

BLOCK = 512
INTEL = 84
MOST = 255  # of a dimension
Value = str | int | float | Sequence[str] | np.ndarray
"""Text, a 16-bit integer, a float, a list of texts, or an array of floats or 16-bit integers
(first dimension fastest, as C3D has it)."""


@dataclass(frozen=True)
class Group:
    """A group of parameters: by name, in the order of the file."""

    description: str
    parameters: Mapping[str, Value]


def _parameter_section(groups: Mapping[str, Group]) -> bytes:
    """All groups as whole blocks of 512 bytes; ValueError where they need more than 255."""
    records = b""
    for number, (name, group) in enumerate(groups.items(), start=1):
        records += _record(-number, name, b"", group.description)
        for parameter, value in group.parameters.items():
            records += _record(number, parameter, _encoded(value), "")
    records += b"\0\0"
    count = -(-(4 + len(records)) // BLOCK)
    if count > MOST:
        raise ValueError(f"C3D parameters: expected at most {MOST} blocks, got {count}")
    return (bytes([1, 80, count, INTEL]) + records).ljust(count * BLOCK, b"\0")


def _long_list(name: str, texts: Sequence[str]) -> dict[str, Value]:
    """A list of texts as one parameter for every 255 of them: NAME, NAME2, NAME3."""
    parts = [texts[first : first + MOST] for first in range(0, len(texts), MOST)] or [texts]
    return {name + (str(k) if k > 1 else ""): part for k, part in enumerate(parts, start=1)}


def _record(group: int, name: str, value: bytes, description: str) -> bytes:
    """A group (negative number) or a parameter: its name, the way to the next, its content."""
    content = value + bytes([len(_ascii(description))]) + _ascii(description)
    label = _ascii(name)
    return (
        struct.pack("<bb", len(label), group)
        + label
        + struct.pack("<h", 2 + len(content))
        + content
    )


def _encoded(value: Value) -> bytes:
    """Type (bytes of an element, -1 for text), dimensions, data."""
    if isinstance(value, str):
        return struct.pack("<bBB", -1, 1, len(_ascii(value))) + _ascii(value)
    if isinstance(value, int):
        return struct.pack("<bBH", 2, 0, value)
    if isinstance(value, float):
        return struct.pack("<bBf", 4, 0, value)
    if isinstance(value, np.ndarray):
        kind, size = ("<f4", 4) if value.dtype.kind == "f" else ("<u2", 2)
        shape = bytes(value.shape[::-1])
        return struct.pack("<bB", size, value.ndim) + shape + value.astype(kind).tobytes()
    texts = [_ascii(text) for text in value]
    width = max((len(text) for text in texts), default=0)
    data = b"".join(text.ljust(width) for text in texts)
    return struct.pack("<bBBB", -1, 2, width, len(texts)) + data


def _ascii(text: str) -> bytes:
    """At most 127 characters of ASCII."""
    return text.encode("ascii", "replace")[:127]


RESIDUAL_MM = 0.5  # a step of the residuals, which are bytes
HEADER_END = 65535  # of frame numbers in the header, 16 bits
SCREEN = {"y": ("+X", "+Y"), "z": ("+X", "+Z")}  # axes to the right and up on the screen
SOFTWARE = "imocap"


@dataclass(frozen=True)
class C3dEvent:
    """An event of a trial: label and context (Left, Right, General), seconds from frame 1."""

    label: str
    context: str
    time_s: float


@dataclass(frozen=True, eq=False)
class C3dTrial:
    """What a C3D file holds.

    Attributes:
        subject: a name without spaces. up: the axis, y or z, that points up.
        fps: frames a second. first: number of the first frame, from 1.
        markers_mm: by label, (T, 3); NaN where missing.
        sd_mm: of some markers, (T,); NaN where unknown.
        angles_deg: by label, (T, 3); NaN where missing.
        descriptions: of some labels. events: in any order.
    """

    subject: str
    up: str
    fps: float
    first: int
    markers_mm: Mapping[str, Float[np.ndarray, "T 3"]]
    sd_mm: Mapping[str, Float[np.ndarray, " T"]]
    angles_deg: Mapping[str, Float[np.ndarray, "T 3"]]
    descriptions: Mapping[str, str]
    events: Sequence[C3dEvent] = ()

    @property
    def frames(self) -> int:
        """How many frames there are."""
        return len(next(iter(self.markers_mm.values())))


def c3d_bytes(trial: C3dTrial) -> bytes:
    """The content of a trial's file: header, parameters, points. ValueError where its labels need
    more than C3D's parameters hold."""
    blocks = len(_parameter_section(_groups(trial, 2))) // BLOCK
    data_start = 2 + blocks
    first, last = trial.first, trial.first + trial.frames - 1
    if last > HEADER_END:  # the parameters TRIAL:ACTUAL_... have the numbers
        first, last = 1, min(trial.frames, HEADER_END)
    points = len(trial.markers_mm) + len(trial.angles_deg)
    head = struct.pack("<BBHHHHH", 2, 80, points, 0, first, last, 0)
    head += struct.pack("<fHHf", -RESIDUAL_MM, data_start, 0, trial.fps)
    return head.ljust(BLOCK, b"\0") + _parameter_section(_groups(trial, data_start)) + _data(trial)


def _groups(trial: C3dTrial, data_start: int) -> dict[str, Group]:
    labels = [*trial.markers_mm, *trial.angles_deg]
    last = trial.first + trial.frames - 1
    right, up = SCREEN[trial.up]
    point: dict[str, Value] = {
        "USED": len(labels),
        "SCALE": -RESIDUAL_MM,
        "RATE": float(trial.fps),
        "DATA_START": data_start,
        "FRAMES": min(trial.frames, HEADER_END),
        **_long_list("LABELS", labels),
        **_long_list("DESCRIPTIONS", [trial.descriptions.get(label, "") for label in labels]),
        "UNITS": "mm",
        "X_SCREEN": right,
        "Y_SCREEN": up,
        "ANGLES": list(trial.angles_deg),
        "ANGLE_UNITS": "deg",
        "TYPE_GROUPS": ["ANGLES"],
    }
    field: dict[str, Value] = {
        "ACTUAL_START_FIELD": _long(trial.first),
        "ACTUAL_END_FIELD": _long(last),
        "CAMERA_RATE": float(trial.fps),
    }
    subjects: dict[str, Value] = {
        "USED": 1,
        "IS_STATIC": 0,
        "NAMES": [trial.subject],
        "LABEL_PREFIXES": [""],
    }
    return {
        "POINT": Group("3D points", point),
        "ANALOG": Group("no analog data", {"USED": 0, "LABELS": [], "RATE": 0.0}),
        "FORCE_PLATFORM": Group("no force plates", {"USED": 0}),
        "TRIAL": Group("frame numbers", field),
        "SUBJECTS": Group("subjects", subjects),
        "MANUFACTURER": Group("origin", {"COMPANY": SOFTWARE, "SOFTWARE": SOFTWARE}),
        "EVENT": Group("events", _events(trial)),
    }


def _events(trial: C3dTrial) -> dict[str, Value]:
    events = sorted(trial.events, key=lambda event: event.time_s)[:255]
    times = np.array([divmod(event.time_s, 60.0) for event in events], dtype=np.float64)
    return {
        "USED": len(events),
        "CONTEXTS": [event.context for event in events],
        "LABELS": [event.label for event in events],
        "TIMES": times.reshape(-1, 2),
        "SUBJECTS": [trial.subject] * len(events),
    }


def _long(number: int) -> np.ndarray:
    """A 32-bit number as two 16-bit ones, the lower half first."""
    return np.array([number & 0xFFFF, number >> 16], dtype=np.uint16)


def _data(trial: C3dTrial) -> bytes:
    """Every frame's points: x, y, z and residual."""
    points = []
    for label, values in [*trial.markers_mm.items(), *trial.angles_deg.items()]:
        there = np.isfinite(values).all(axis=1)
        sd = np.nan_to_num(trial.sd_mm.get(label, np.zeros(len(values))))
        residual = np.clip(np.ceil(sd / RESIDUAL_MM), 0, 255)
        fourth = np.where(there, residual, -1.0)
        points.append(np.c_[np.where(there[:, None], values, 0.0), fourth])
    data = np.stack(points, axis=1).astype("<f4").tobytes()
    return data.ljust(-(-len(data) // BLOCK) * BLOCK, b"\0")

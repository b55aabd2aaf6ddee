"""Forward kinematics of an .osim file and a .mot file, read plainly: where its markers are."""

from pathlib import Path
from xml.etree.ElementTree import Element, parse

import numpy as np
from scipy.spatial.transform import Rotation


def marker_places_m(model: Path, values: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Every marker (T, 3) in the ground's axes. values: coordinates over time, radians, metres."""
    root = parse(model).getroot()
    count = len(next(iter(values.values())))
    frames = {"/ground": (np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)))}
    for joint in root.iter("CustomJoint"):
        offsets = {f.get("name"): f for f in joint.iter("PhysicalOffsetFrame")}
        parent = offsets[text(joint, "socket_parent_frame")]
        child = offsets[text(joint, "socket_child_frame")]
        assert not numbers(child, "translation").any()
        R, origin = frames[text(parent, "socket_parent")]
        origin = origin + R @ numbers(parent, "translation")
        turns, moves = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
        for transform in joint.iter("TransformAxis"):
            coordinate = (transform.find("coordinates").text or "").strip()  # type: ignore[union-attr]
            amount = values[coordinate] if coordinate else np.zeros(count)
            along = amount[:, None] * numbers(transform, "axis")
            if str(transform.get("name")).startswith("rotation"):
                turns = turns @ Rotation.from_rotvec(along).as_matrix()
            else:
                moves = moves + along
        frames[text(child, "socket_parent")] = (
            R @ turns,
            origin + np.einsum("tij,tj->ti", R, moves),
        )
    places = {}
    for marker in root.iter("Marker"):
        R, origin = frames[text(marker, "socket_parent_frame")]
        places[str(marker.get("name"))] = origin + R @ numbers(marker, "location")
    return places


def text(element: Element, name: str) -> str:
    return str(element.findtext(name)).strip()


def numbers(element: Element, name: str) -> np.ndarray:
    return np.array([float(x) for x in text(element, name).split()])

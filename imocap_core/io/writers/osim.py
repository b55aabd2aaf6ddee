"""OpenSim: models, marker sets, scaling, inverse kinematics, motions.

OpenSim models (.osim, version 4): a linkage with markers, masses and ellipsoids to look at. The
shoulder turns about Y, X and Y, which OpenSim refuses in one joint, as its axes lie in one plane: a
nearly massless body stands between the plane and elevation, and the axial rotation.

Setups for a full-body OpenSim model that the user has: marker set, scaling, inverse kinematics.
Such models (Rajagopal 2016 and those made from it) have one body a segment, whose origin is the
joint centre at its upper end: the markers are these centres, and need no place to be guessed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, SubElement, indent

import numpy as np
from jaxtyping import Float

from imocap_core.biomechanics.linkage import Link, SegmentMass

VERSION = "40000"
SMALL_KG, SMALL_KG_M2 = 1e-3, 1e-5  # of the body within a shoulder
RANGE_DEG, RANGE_M = 180.0, 5.0  # for sliders; nothing is clamped
COLOUR = "0.75 0.7 0.65"
Place = tuple[str, Float[np.ndarray, "3"]]


def write_osim(
    file: Path,
    name: str,
    links: Mapping[str, Link],
    masses: Mapping[str, SegmentMass],
    markers: Mapping[str, Place],
) -> None:
    """Write a model. markers: by name the segment that each is on, and its place in its axes."""
    document = Element("OpenSimDocument", Version=VERSION)
    units = {"gravity": "0 -9.80665 0", "length_units": "meters", "force_units": "N"}
    model = _add(document, "Model", name, units)
    bodies, joints = _objects(model, "BodySet"), _objects(model, "JointSet")
    for link in links.values():
        _joints(bodies, joints, link)
        _body(bodies, link.segment, masses[link.segment])
    _add_markers(model, markers)
    _write_document(file, document)


def _write_document(file: Path, document: Element) -> None:
    """Write an OpenSim document with its declaration, indented."""
    indent(document)
    ElementTree(document).write(file, encoding="UTF-8", xml_declaration=True)


def _add_markers(parent: Element, markers: Mapping[str, Place]) -> None:
    """A set of markers, by name the body that each is on and its place in its axes."""
    objects = _objects(parent, "MarkerSet")
    for name, (segment, place) in markers.items():
        fields = {"socket_parent_frame": f"/bodyset/{segment}", "location": _numbers(place)}
        _add(objects, "Marker", name, fields | {"fixed": "true"})


def _add(parent: Element, kind: str, name: str = "", fields: Mapping[str, str] = {}) -> Element:
    """Add an element, with a name where one is given, and its fields as elements with a text."""
    element = SubElement(parent, kind, {"name": name} if name else {})
    for field, text in fields.items():
        SubElement(element, field).text = text
    return element


def _objects(parent: Element, kind: str) -> Element:
    return SubElement(_add(parent, kind, kind.lower()), "objects")


def _body(bodies: Element, name: str, mass: SegmentMass) -> None:
    body = _add(bodies, "Body", name)
    shape = _add(SubElement(body, "components"), "PhysicalOffsetFrame", "middle")
    geometry = SubElement(shape, "attached_geometry")
    ellipsoid = _add(geometry, "Ellipsoid", "shape", {"socket_frame": ".."})
    _add(ellipsoid, "Appearance", "", {"color": COLOUR})
    SubElement(ellipsoid, "radii").text = _numbers(mass.radii_m)
    SubElement(shape, "socket_parent").text = ".."
    SubElement(shape, "translation").text = _numbers(mass.centre_m)
    SubElement(body, "mass").text = f"{mass.mass_kg:.4f}"
    SubElement(body, "mass_center").text = _numbers(mass.centre_m)
    SubElement(body, "inertia").text = _numbers(np.r_[mass.inertia_kg_m2, np.zeros(3)])


def _joints(bodies: Element, joints: Element, link: Link) -> None:
    """The joint of a link; where the third axis is again the first, two joints."""
    parent = "/ground" if link.parent is None else f"/bodyset/{link.parent}"
    axes = [(c.name, c.axis) for c in link.rotations]
    if len(axes) == 3 and abs(axes[0][1] @ axes[2][1]) > 0.99:
        between = f"{link.joint}_plane_and_elevation"
        inertia = _numbers(np.r_[[SMALL_KG_M2] * 3, np.zeros(3)])
        fields = {"mass": str(SMALL_KG), "mass_center": "0 0 0", "inertia": inertia}
        _add(bodies, "Body", between, fields)
        _joint(joints, between, (parent, link.place_m), between, axes[:2], link.translations)
        inner = (f"/bodyset/{between}", np.zeros(3))
        _joint(joints, link.joint, inner, link.segment, axes[2:], ())
    else:
        place = (parent, link.place_m)
        _joint(joints, link.joint, place, link.segment, axes, link.translations)


def _joint(
    joints: Element,
    name: str,
    place: Place,
    child: str,
    rotations: list[Place],
    translations: tuple[str, ...],
) -> None:
    sockets = {"socket_parent_frame": "parent_offset", "socket_child_frame": "child_offset"}
    joint = _add(joints, "CustomJoint", name, sockets)
    coordinates = SubElement(joint, "coordinates")
    for coordinate, reach in [
        *((c, np.radians(RANGE_DEG)) for c, _ in rotations),
        *((c, RANGE_M) for c in translations),
    ]:
        span = _numbers(np.array([-reach, reach]))
        fields = {"default_value": "0", "range": span, "clamped": "false"}
        _add(coordinates, "Coordinate", coordinate, fields)
    frames = SubElement(joint, "frames")
    for frame, (body, where) in (
        ("parent_offset", place),
        ("child_offset", (f"/bodyset/{child}", np.zeros(3))),
    ):
        fields = {"socket_parent": body, "translation": _numbers(where), "orientation": "0 0 0"}
        _add(frames, "PhysicalOffsetFrame", frame, fields)
    _transform(joint, rotations, translations)


def _transform(joint: Element, rotations: list[Place], translations: tuple[str, ...]) -> None:
    """Three rotations and three translations, each about an axis by a coordinate or by nothing."""
    transform = SubElement(joint, "SpatialTransform")
    turns: list[tuple[str, Float[np.ndarray, "3"]]] = list(rotations)
    for axis in np.eye(3):  # unused axes must not lie along those that are used
        if len(turns) < 3 and all(abs(axis @ used) < 0.5 for _, used in turns):
            turns.append(("", axis))
    moves = translations or ("", "", "")
    named = [(f"rotation{k + 1}", turn) for k, turn in enumerate(turns)]
    named += [
        (f"translation{k + 1}", move) for k, move in enumerate(zip(moves, np.eye(3), strict=True))
    ]
    for name, (coordinate, axis) in named:
        fields = {"coordinates": coordinate, "axis": _numbers(axis)}
        element = _add(transform, "TransformAxis", name, fields)
        if coordinate:
            _add(element, "LinearFunction", "function", {"coefficients": "1 0"})
        else:
            _add(element, "Constant", "function", {"value": "0"})


def _numbers(values: np.ndarray) -> str:
    return " ".join(f"{value:.9g}" for value in values)


ACCURACY = 1e-5


def write_ik_setup(
    file: Path, name: str, markers: Iterable[str], last_s: float, trc: str | None = None
) -> None:
    """A setup of inverse kinematics for NAME.osim and NAME.trc beside it, which writes NAME_ik.mot.

    Args:
        markers: those to follow, all of one weight.
        last_s: end of the motion, which begins at 0.
        trc: name of the file of the markers where it is not NAME.trc.
    """
    document = Element("OpenSimDocument", Version=VERSION)
    fields = {
        "results_directory": "./",
        "input_directory": "",
        "model_file": f"{name}.osim",
        "constraint_weight": "Inf",
        "accuracy": str(ACCURACY),
        "time_range": f"0 {last_s:.6f}",
        "output_motion_file": f"{name}_ik.mot",
        "report_errors": "true",
        "marker_file": trc or f"{name}.trc",
        "report_marker_locations": "false",
    }
    tool = _add(document, "InverseKinematicsTool", name, fields)
    objects = SubElement(SubElement(tool, "IKTaskSet"), "objects")
    for marker in markers:
        _add(objects, "IKMarkerTask", marker, {"apply": "true", "weight": "1"})
    _write_document(file, document)


def write_mot(
    file: Path, name: str, fps: float, columns: Mapping[str, Float[np.ndarray, " T"]]
) -> None:
    """A motion: columns of coordinates over time, angles in degrees, translations in metres."""
    values = np.stack(list(columns.values()), axis=1)
    head = [
        name,
        "version=1",
        f"nRows={len(values)}",
        f"nColumns={1 + len(columns)}",
        "inDegrees=yes",
        "endheader",
        "\t".join(["time", *columns]),
    ]
    rows = [
        "\t".join([f"{t / fps:.6f}", *(f"{value:.6f}" for value in row)])
        for t, row in enumerate(values)
    ]
    file.write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8", newline="\n")


MODEL = "generic.osim"  # as which the user's model lies beside the files
MARKERS = "generic_markers.xml"
BODY_OF_CENTRE = {  # the body whose origin a joint centre is, less the side
    "hip": "femur",
    "knee": "tibia",
    "ankle": "talus",
    "foot": "toes",
    "shoulder": "humerus",
    "elbow": "ulna",
    "wrist": "hand",
}
SIDES = {"left": "l", "right": "r"}
PAIRS: dict[str, tuple[tuple[tuple[str, str], ...], tuple[str, ...]]] = {
    # distances between markers of one side (of both, where named), and the bodies that they scale
    "thigh": ((("hip", "knee"),), ("femur",)),
    "shank": ((("knee", "ankle"),), ("tibia",)),
    "foot": ((("ankle", "foot"),), ("talus", "calcn", "toes")),
    "upper_arm": ((("shoulder", "elbow"),), ("humerus",)),
    "forearm": ((("elbow", "wrist"),), ("ulna", "radius", "hand")),
}
MIDDLE: dict[str, tuple[tuple[tuple[str, str], ...], str]] = {
    "pelvis": ((("left_hip", "right_hip"),), "pelvis"),
    "trunk": ((("left_hip", "left_shoulder"), ("right_hip", "right_shoulder")), "torso"),
}


def generic_markers() -> list[str]:
    """The joint centres that are markers of a generic model."""
    return [f"{side}_{centre}" for side in SIDES for centre in BODY_OF_CENTRE]


def write_generic_markers(folder: Path) -> Path:
    """Write the marker set, generic_markers.xml."""
    document = Element("OpenSimDocument", Version=VERSION)
    places = {
        f"{side}_{centre}": (f"{body}_{letter}", np.zeros(3))
        for side, letter in SIDES.items()
        for centre, body in BODY_OF_CENTRE.items()
    }
    _add_markers(document, places)
    _write_document(folder / MARKERS, document)
    return folder / MARKERS


def write_generic_setups(folder: Path, name: str, mass_kg: float, last_s: float) -> list[Path]:
    """Write the scaling of generic.osim to NAME.trc, and inverse kinematics of the scaled model.

    mass_kg: of the scaled model. last_s: end of the motion, which begins at 0.
    """
    scale, scaled = folder / f"{name}_generic_scale.xml", f"{name}_generic"
    document = Element("OpenSimDocument", Version=VERSION)
    tool = _add(document, "ScaleTool", scaled, {"mass": f"{mass_kg:.2f}"})
    _add(tool, "GenericModelMaker", "", {"model_file": MODEL, "marker_set_file": MARKERS})
    scaler = _add(tool, "ModelScaler", "", {"apply": "true", "scaling_order": "measurements"})
    objects = SubElement(SubElement(scaler, "MeasurementSet"), "objects")
    for measurement, pairs, bodies in _measurements():
        _measurement(objects, measurement, pairs, bodies)
    for key, value in {
        "marker_file": f"{name}.trc",
        "time_range": f"0 {last_s:.6f}",
        "preserve_mass_distribution": "true",
        "output_model_file": f"{scaled}.osim",
    }.items():
        SubElement(scaler, key).text = value
    _add(tool, "MarkerPlacer", "", {"apply": "false"})
    _write_document(scale, document)
    setup = folder / f"{name}_generic_ik.xml"
    write_ik_setup(setup, scaled, generic_markers(), last_s, trc=f"{name}.trc")
    return [scale, setup]


def _measurements() -> list[tuple[str, list[tuple[str, str]], list[str]]]:
    """Every measurement: its name, its pairs of markers, the bodies that it scales."""
    every = [(name, list(pairs), [body]) for name, (pairs, body) in MIDDLE.items()]
    for side, letter in SIDES.items():
        for name, (pairs, bodies) in PAIRS.items():
            sided = [(f"{side}_{a}", f"{side}_{b}") for a, b in pairs]
            every.append((f"{side}_{name}", sided, [f"{body}_{letter}" for body in bodies]))
    return every


def _measurement(
    objects: Element, name: str, pairs: Sequence[tuple[str, str]], bodies: Sequence[str]
) -> None:
    measurement = _add(objects, "Measurement", name, {"apply": "true"})
    paired = SubElement(SubElement(measurement, "MarkerPairSet"), "objects")
    for pair in pairs:
        _add(paired, "MarkerPair", "", {"markers": " ".join(pair)})
    scaled = SubElement(SubElement(measurement, "BodyScaleSet"), "objects")
    for body in bodies:
        _add(scaled, "BodyScale", body, {"axes": "X Y Z"})

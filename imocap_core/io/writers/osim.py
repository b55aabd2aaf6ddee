"""OpenSim models (.osim, version 4): a linkage with markers, masses and ellipsoids to look at.

The shoulder turns about Y, X and Y, which OpenSim refuses in one joint, as its axes lie in one
plane: a nearly massless body stands between the plane and elevation, and the axial rotation.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, SubElement, indent

import numpy as np
from jaxtyping import Float

from imocap_core.biomechanics.linkage import Link
from imocap_core.biomechanics.segment_masses import SegmentMass

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
    model = SubElement(document, "Model", name=name)
    SubElement(model, "gravity").text = "0 -9.80665 0"
    SubElement(model, "length_units").text = "meters"
    SubElement(model, "force_units").text = "N"
    bodies, joints = _objects(model, "BodySet"), _objects(model, "JointSet")
    for link in links.values():
        _joints(bodies, joints, link)
        _body(bodies, link.segment, masses[link.segment])
    add_markers(model, markers)
    write_document(file, document)


def write_document(file: Path, document: Element) -> None:
    """Write an OpenSim document with its declaration, indented."""
    indent(document)
    ElementTree(document).write(file, encoding="UTF-8", xml_declaration=True)


def add_markers(parent: Element, markers: Mapping[str, Place]) -> None:
    """A set of markers, by name the body that each is on and its place in its axes."""
    objects = _objects(parent, "MarkerSet")
    for name, (segment, place) in markers.items():
        marker = SubElement(objects, "Marker", name=name)
        SubElement(marker, "socket_parent_frame").text = f"/bodyset/{segment}"
        SubElement(marker, "location").text = _numbers(place)
        SubElement(marker, "fixed").text = "true"


def _objects(parent: Element, kind: str) -> Element:
    return SubElement(SubElement(parent, kind, name=kind.lower()), "objects")


def _body(bodies: Element, name: str, mass: SegmentMass) -> None:
    body = SubElement(bodies, "Body", name=name)
    shape = SubElement(SubElement(body, "components"), "PhysicalOffsetFrame", name="middle")
    geometry = SubElement(shape, "attached_geometry")
    ellipsoid = SubElement(geometry, "Ellipsoid", name="shape")
    SubElement(ellipsoid, "socket_frame").text = ".."
    SubElement(SubElement(ellipsoid, "Appearance"), "color").text = COLOUR
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
        body = SubElement(bodies, "Body", name=between)
        SubElement(body, "mass").text = str(SMALL_KG)
        SubElement(body, "mass_center").text = "0 0 0"
        SubElement(body, "inertia").text = _numbers(np.r_[[SMALL_KG_M2] * 3, np.zeros(3)])
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
    joint = SubElement(joints, "CustomJoint", name=name)
    SubElement(joint, "socket_parent_frame").text = "parent_offset"
    SubElement(joint, "socket_child_frame").text = "child_offset"
    coordinates = SubElement(joint, "coordinates")
    for coordinate, reach in [
        *((c, np.radians(RANGE_DEG)) for c, _ in rotations),
        *((c, RANGE_M) for c in translations),
    ]:
        element = SubElement(coordinates, "Coordinate", name=coordinate)
        SubElement(element, "default_value").text = "0"
        SubElement(element, "range").text = _numbers(np.array([-reach, reach]))
        SubElement(element, "clamped").text = "false"
    frames = SubElement(joint, "frames")
    for frame, (body, where) in (
        ("parent_offset", place),
        ("child_offset", (f"/bodyset/{child}", np.zeros(3))),
    ):
        offset = SubElement(frames, "PhysicalOffsetFrame", name=frame)
        SubElement(offset, "socket_parent").text = body
        SubElement(offset, "translation").text = _numbers(where)
        SubElement(offset, "orientation").text = "0 0 0"
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
        element = SubElement(transform, "TransformAxis", name=name)
        SubElement(element, "coordinates").text = coordinate
        SubElement(element, "axis").text = _numbers(axis)
        if coordinate:
            function = SubElement(element, "LinearFunction", name="function")
            SubElement(function, "coefficients").text = "1 0"
        else:
            function = SubElement(element, "Constant", name="function")
            SubElement(function, "value").text = "0"


def _numbers(values: np.ndarray) -> str:
    return " ".join(f"{value:.9g}" for value in values)

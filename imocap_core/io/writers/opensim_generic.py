"""Setups for a full-body OpenSim model that the user has: marker set, scaling, inverse kinematics.

Such models (Rajagopal 2016 and those made from it) have one body a segment, whose origin is the
joint centre at its upper end: the markers are these centres, and need no place to be guessed.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from imocap_core.io.writers.opensim_files import write_ik_setup
from imocap_core.io.writers.osim import VERSION, add_markers, write_document

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
    add_markers(document, places)
    write_document(folder / MARKERS, document)
    return folder / MARKERS


def write_generic_setups(folder: Path, name: str, mass_kg: float, last_s: float) -> list[Path]:
    """Write the scaling of generic.osim to NAME.trc, and inverse kinematics of the scaled model.

    mass_kg: of the scaled model. last_s: end of the motion, which begins at 0.
    """
    scale, scaled = folder / f"{name}_generic_scale.xml", f"{name}_generic"
    document = Element("OpenSimDocument", Version=VERSION)
    tool = SubElement(document, "ScaleTool", name=scaled)
    SubElement(tool, "mass").text = f"{mass_kg:.2f}"
    maker = SubElement(tool, "GenericModelMaker")
    SubElement(maker, "model_file").text = MODEL
    SubElement(maker, "marker_set_file").text = MARKERS
    scaler = SubElement(tool, "ModelScaler")
    SubElement(scaler, "apply").text = "true"
    SubElement(scaler, "scaling_order").text = "measurements"
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
    SubElement(SubElement(tool, "MarkerPlacer"), "apply").text = "false"
    write_document(scale, document)
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
    measurement = SubElement(objects, "Measurement", name=name)
    SubElement(measurement, "apply").text = "true"
    paired = SubElement(SubElement(measurement, "MarkerPairSet"), "objects")
    for pair in pairs:
        SubElement(SubElement(paired, "MarkerPair"), "markers").text = " ".join(pair)
    scaled = SubElement(SubElement(measurement, "BodyScaleSet"), "objects")
    for body in bodies:
        SubElement(SubElement(scaled, "BodyScale", name=body), "axes").text = "X Y Z"

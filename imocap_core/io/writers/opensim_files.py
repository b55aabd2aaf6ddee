"""OpenSim's inverse kinematics setup, and motions (.mot)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from jaxtyping import Float

from imocap_core.io.writers.osim import VERSION, write_document

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
    tool = SubElement(document, "InverseKinematicsTool", name=name)
    for key, value in {
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
    }.items():
        SubElement(tool, key).text = value
    objects = SubElement(SubElement(tool, "IKTaskSet"), "objects")
    for marker in markers:
        task = SubElement(objects, "IKMarkerTask", name=marker)
        SubElement(task, "apply").text = "true"
        SubElement(task, "weight").text = "1"
    write_document(file, document)


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

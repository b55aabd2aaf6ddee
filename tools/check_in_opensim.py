"""Runs OpenSim's inverse kinematics on an export and compares its angles with ours.

    imocap export ACTION --format opensim --origin start --out FOLDER
    python -m tools.check_in_opensim FOLDER --opensim PYTHON [--generic MODEL]

PYTHON is an interpreter that has `opensim`. Every setup in FOLDER is run as it is, in a copy. With
a full-body model, MODEL.osim, this is scaled and solved too, and its angles are compared as far as
it has them.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from imocap_core.conventions import SIDES

PROGRAM = """
import sys
import opensim
opensim.Logger.setLevelString("error")
for setup in sys.argv[1:]:
    if setup.endswith("_scale.xml"):
        opensim.ScaleTool(setup).run()  # False where, as here, no markers are to be moved
    elif not opensim.InverseKinematicsTool(setup).run():
        sys.exit(f"{setup}: failed")
"""
# Our angle: coordinates of full-body models that mean about the same, and their sign.
GENERIC: dict[str, tuple[tuple[str, ...], int]] = {
    "pelvis_tilt": (("pelvis_tilt",), -1),
    "pelvis_obliquity": (("pelvis_list",), -1),
    "pelvis_rotation": (("pelvis_rotation",), 1),
    "trunk_flexion": (("lumbar_extension", "L5_S1_Flex_Ext"), -1),
    "trunk_right_bending": (("lumbar_bending", "L5_S1_Lat_Bending"), 1),
    "trunk_left_rotation": (("lumbar_rotation", "L5_S1_axial_rotation"), 1),
}
GENERIC_SIDED = {
    "hip_flexion": "hip_flexion",
    "hip_adduction": "hip_adduction",
    "hip_internal_rotation": "hip_rotation",
    "knee_flexion": "knee_angle",
    "ankle_dorsiflexion": "ankle_angle",
    "elbow_flexion": "elbow_flex",
    "elbow_pronation": "pro_sup",
}
GENERIC |= {
    f"{side}_{ours}": ((f"{theirs}_{side[0]}",), 1)
    for ours, theirs in GENERIC_SIDED.items()
    for side in SIDES
}
LEAST_ELEVATION_DEG = 5.0  # of the arm: below it, or this near to 180, it has no plane
END, TIME = "endheader", "time"


@dataclass(frozen=True, eq=False)
class Solved:
    """One video: marker errors over time, mm, and angles by name (ours, OpenSim's), degrees."""

    rms_mm: np.ndarray
    largest_mm: np.ndarray
    angles_deg: dict[str, tuple[np.ndarray, np.ndarray]]


def solve(folder: Path, opensim: Path, model: Path | None = None) -> dict[str, Solved]:
    """Inverse kinematics of every video of an export, by its id, with its own model or another."""
    kind = "_generic" if model else ""
    setups = sorted(folder.glob("*_ik.xml"))
    ids = [f.name.removesuffix("_ik.xml") for f in setups if not f.stem.endswith("_generic_ik")]
    with tempfile.TemporaryDirectory() as place:
        work = Path(place) / "export"
        shutil.copytree(folder, work)
        steps = ["ik"]
        if model:
            shutil.copy(model, work / "generic.osim")
            steps = ["scale", "ik"]
        names = [f"{name}{kind}_{step}.xml" for name in ids for step in steps]
        subprocess.run([opensim, "-c", PROGRAM, *names], cwd=work, check=True, stdout=sys.stderr)
        return {name: _solved(work, name, kind) for name in ids}


def _solved(work: Path, name: str, kind: str) -> Solved:
    errors = read_storage(work / f"{name}{kind}_ik_marker_errors.sto")
    ours, theirs = read_storage(work / f"{name}.mot"), read_storage(work / f"{name}{kind}_ik.mot")
    if kind:
        theirs = {n: s * theirs[c] for n, (all_, s) in GENERIC.items() for c in all_ if c in theirs}
    theirs = with_raised_arms(theirs)
    named = [c for c in ours if c != TIME and c[-3:-1] != "_t" and c in theirs]
    angles = {c: (ours[c], theirs[c]) for c in named}
    mm = 1000.0
    return Solved(mm * errors["marker_error_RMS"], mm * errors["marker_error_max"], angles)


def with_raised_arms(angles: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The same postures with elevations of 0 to 180 degrees: a negative one, which OpenSim may find
    as well, is the positive one in the opposite plane."""
    raised = dict(angles)
    for side in SIDES:
        names = [f"{side}_shoulder_{n}" for n in ("plane", "elevation", "internal_rotation")]
        if set(names) <= set(angles):
            plane, elevation, rotation = (angles[name] for name in names)
            elevation = (elevation + 180) % 360 - 180
            half = np.where(elevation < 0, 180.0, 0.0)
            turned = plane + half, np.abs(elevation), rotation - half
            raised |= dict(zip(names, turned, strict=True))
    return raised


def read_storage(file: Path) -> dict[str, np.ndarray]:
    """The columns of one of OpenSim's tables (.mot, .sto)."""
    lines = file.read_text().splitlines()
    first = lines.index(END) + 1
    rows = np.array([[float(x) for x in line.split()] for line in lines[first + 1 :] if line])
    return dict(zip(lines[first].split(), rows.T, strict=True))


def differences_deg(solved: Solved) -> dict[str, np.ndarray]:
    """OpenSim's angle less ours, by angle, both sides together; without moments at which an arm
    that hangs or points up has no plane."""
    each = defaultdict(list)
    for name, (ours, theirs) in solved.angles_deg.items():
        away = (theirs - ours + 180) % 360 - 180
        side, _, rest = name.partition("_")
        if rest in ("shoulder_plane", "shoulder_internal_rotation"):
            elevation = np.abs(solved.angles_deg[f"{side}_shoulder_elevation"][0])
            away = away[np.minimum(elevation, 180 - elevation) > LEAST_ELEVATION_DEG]
        each[rest if side in SIDES else name].append(away)
    return {name: np.concatenate(parts) for name, parts in each.items()}


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--opensim", type=Path, default=Path(sys.executable))
    parser.add_argument("--generic", type=Path)
    given = parser.parse_args(arguments)
    for model in [None, given.generic] if given.generic else [None]:
        print(f"\n{model.name if model else 'its own models'}\n")
        _print(solve(given.folder, given.opensim, model))


def _print(solved: dict[str, Solved]) -> None:
    """Tables of the marker errors and of the differences of the angles."""
    print("| video | frames | marker errors, RMS | largest |\n|---|---:|---:|---:|")
    for name, video in solved.items():
        rms = np.sqrt((video.rms_mm**2).mean())
        print(f"| {name} | {len(video.rms_mm)} | {rms:.1f} mm | {video.largest_mm.max():.1f} mm |")
    each = [differences_deg(video) for video in solved.values()]
    print("\n| angle | mean difference | mean size | largest |\n|---|---:|---:|---:|")
    for name in each[0]:
        away = np.concatenate([video[name] for video in each])
        if len(away):
            mean, size, most = away.mean(), np.abs(away).mean(), np.abs(away).max()
            print(f"| `{name}` | {mean:+.1f} | {size:.1f} | {most:.1f} |")


if __name__ == "__main__":
    main()

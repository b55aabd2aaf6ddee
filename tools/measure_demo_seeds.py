"""The demo of other seeds, the whole body: ``python -m tools.measure_demo_seeds ROOT yoga:21``.

Each action is made and run in a folder of its own below ROOT, unless it was; a row of the table per
action, after the loop: other performers, performances, cameras and detection errors.
"""

from __future__ import annotations

import argparse
import csv
import shutil
import subprocess
import sys
from pathlib import Path

from imocap_core.pipeline.make_demo import make_demo
from imocap_core.pipeline.source import PROJECT

RESULT = "after loop"
SPINE = ("spine1", "spine2", "spine3")
COLLARS_NECK = ("left_collar", "right_collar", "neck")
COLUMNS = (
    "scaled MPJPE / P-MPJPE mm",
    "spine1, 2, 3 mm",
    "collars, neck mm",
    "spine1, 2, 3 °",
    "PVE mm",
    "without hands mm",
)
Row = dict[str, str]


def run_demo(root: Path, name: str) -> Path:
    """The report folder of a demo action that was run to its scores."""
    command = "import sys; from imocap_core.cli import main; sys.exit(main())"
    words = ["--root", str(root), "stage", "evaluate", name, "--set", "evaluate.figures=false"]
    subprocess.run([sys.executable, "-c", command, *words], cwd=PROJECT, check=True)
    return root / "artifacts" / name / "report"


def rows_of(file: Path, key: str) -> dict[str, Row]:
    """The rows of a report's table by one of its columns."""
    with file.open(newline="", encoding="utf-8") as stream:
        return {row[key]: row for row in csv.DictReader(stream)}


def cells(report: Path) -> list[str]:
    """The columns of the table, from a report's files."""
    pose = rows_of(report / "joint_sets.csv", "result")[RESULT]
    body = rows_of(report / "whole_body.csv", "result")[RESULT]
    places = rows_of(report / "joints.csv", "joint")
    turns = rows_of(report / "joint_rotations.csv", "joint")

    def values(rows: dict[str, Row], joints: tuple[str, ...], unit: str) -> str:
        return ", ".join(f"{float(rows[joint][f'after_loop_{unit}']):.1f}" for joint in joints)

    return [
        f"{float(pose['mpjpe_scaled_mm']):.1f} / {float(pose['pa_mpjpe_mm']):.1f}",
        values(places, SPINE, "mm"),
        values(places, COLLARS_NECK, "mm"),
        values(turns, SPINE, "deg"),
        f"{float(body['pve_mm']):.1f}",
        f"{float(body['pve_without_hands_mm']):.1f}",
    ]


def main() -> None:
    """Make, run, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("root", type=Path)
    parser.add_argument("demos", nargs="+", help="NAME:SEED")
    arguments = parser.parse_args()
    lines = ["| action, seed | " + " | ".join(COLUMNS) + " |", "|---|" + "---:|" * len(COLUMNS)]
    for demo in arguments.demos:
        name, _, seed = demo.partition(":")
        root = arguments.root / f"{name}{seed}"
        action = root / "actions" / name
        if not action.exists():
            make_demo(name, action, int(seed))
            shutil.copy(PROJECT / "pipeline.yaml", root)
        lines.append(f"| {name}, {seed} | " + " | ".join(cells(run_demo(root, name))) + " |")
    print("\n".join(lines))


if __name__ == "__main__":
    main()

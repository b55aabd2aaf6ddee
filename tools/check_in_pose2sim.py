"""Pose2Sim triangulates an event with our calibration and with its own, and both are compared.

    python tools/check_in_pose2sim.py ACTION --root ROOT --pose2sim PYTHON

ACTION: a folder of real videos of one event with OpenPose detections and `calibration.npz` beside
action.yaml (`io/pose2sim_truth.py`), already run with `event: true`. PYTHON: one that has pose2sim.
"""

from __future__ import annotations

import argparse
import csv
import json
import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

import imocap
from imocap_core.alignment import similarity
from imocap_core.io.writers.text_files import CameraCalibration, calib_toml

TRIANGULATE = """
import os, sys, tomllib
from Pose2Sim import Pose2Sim
config = tomllib.load(open(sys.argv[1], "rb"))
os.chdir(sys.argv[2])
config["project"].update(project_dir=sys.argv[2], frame_rate=60, frame_range="all")
config["pose"].update(pose_model="BODY_25B", overwrite_pose=False)
config["triangulation"].update(make_c3d=False, fill_large_gaps_with="nan")
config["logging"] = {"use_custom_logging": True}
import logging
logging.basicConfig(level=logging.INFO)
Pose2Sim.triangulation(config)
"""


def main() -> None:
    """Print how far both triangulations lie from each other."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("action")
    parser.add_argument("--root", type=Path, required=True)
    parser.add_argument("--pose2sim", required=True)
    given = parser.parse_args()
    folder = given.root / "actions" / given.action
    result = imocap.load(given.root / "artifacts" / given.action)
    sizes = {video.id: video.camera.size for video in result}
    ids = list(sizes)
    with tempfile.TemporaryDirectory() as draft:
        result.export("calib", Path(draft) / "calib")
        ours = (Path(draft) / "calib" / "Calib.toml").read_text()
        matched = matched_frames(Path(draft) / "calib" / "sync.csv", ids)
        with np.load(folder / "calibration.npz") as true:
            rows = zip(true["cams"], true["K"], true["R"], true["t"], true["dist"], strict=True)
            cameras = [
                CameraCalibration(str(i), sizes[str(i)], K, R, t, (float(d[0]),))
                for i, K, R, t, d in rows
            ]
        equal = [dict.fromkeys(ids, frame[ids[0]]) for frame in matched]
        results = {}
        for name, calibration, frames in (
            ("our calibration", ours, matched),
            ("its own", calib_toml(cameras), equal),
        ):
            project = Path(draft) / name.replace(" ", "_")
            results[name] = triangulated(given.pose2sim, project, folder, calibration, frames)
    compare(results)


def matched_frames(sync: Path, ids: Sequence[str]) -> list[dict[str, int]]:
    """Source frames of all videos at the frames of the reference that every other video shows."""
    to_reference: dict[str, dict[int, float]] = {i: {} for i in ids}
    with sync.open() as file:
        for row in csv.DictReader(file):
            if row["reference_frame"]:
                to_reference[row["video"]][int(row["frame"])] = float(row["reference_frame"])
    others = [i for i in ids if to_reference[i]]
    (reference,) = set(ids) - set(others)
    spans = [(min(m.values()), max(m.values())) for m in to_reference.values() if m]
    first, last = np.ceil(max(a for a, _ in spans)), np.floor(min(b for _, b in spans))
    table = []
    for frame in range(int(first), int(last) + 1):
        nearest = {i: min(m, key=lambda f: abs(m[f] - frame)) for i, m in to_reference.items() if m}
        table.append({**nearest, reference: frame})
    return table


def triangulated(
    python: str, project: Path, action: Path, calibration: str, frames: Sequence[Mapping[str, int]]
) -> tuple[str, Float[np.ndarray, "N J 3"]]:
    """What Pose2Sim says of the reprojection, and its points."""
    (project / "calibration").mkdir(parents=True)
    (project / "calibration" / "Calib.toml").write_text(calibration)
    for video in sorted(frames[0]):
        target = project / "pose" / f"{video}_json"
        target.mkdir(parents=True)
        for n, frame in enumerate(frames):
            source = action / "keypoints" / video / f"{video}.{frame[video]:04d}.json"
            shutil.copy(source, target / f"{video}_{n:06d}.json")
    package = subprocess.run(
        [python, "-c", "import Pose2Sim; print(list(Pose2Sim.__path__)[0])"],
        capture_output=True,
        text=True,
        check=True,
    )
    config = Path(package.stdout.strip()) / "Demo_SinglePerson" / "Config.toml"
    run = subprocess.run(
        [python, "-c", TRIANGULATE, str(config), str(project)], capture_output=True, text=True
    )
    log = run.stdout + run.stderr
    files = sorted((project / "pose-3d").glob("*.trc"))
    assert files, log
    words = re.findall(r"Mean reprojection error for all points[^\n]*", log)
    return " ".join(words), read_trc(files[0])


def read_trc(file: Path) -> Float[np.ndarray, "N J 3"]:
    """The markers of a TRC file, in its unit."""
    rows = [line.split("\t") for line in file.read_text().splitlines()[5:] if line.strip()]
    width = max(len(row) for row in rows)
    values = [
        [float(cell) if cell.strip() else np.nan for cell in [*row, *[""] * (width - len(row))]][2:]
        for row in rows
    ]
    flat = np.array(values)
    return flat[:, : flat.shape[1] // 3 * 3].reshape(len(flat), -1, 3)


def compare(results: Mapping[str, tuple[str, Float[np.ndarray, "N J 3"]]]) -> None:
    """Print reprojection errors and the distance after one similarity for the whole clip."""
    (_, ours), (_, theirs) = results.values()
    for name, (errors, points) in results.items():
        print(json.dumps({"calibration": name, "points": list(points.shape), "pose2sim": errors}))
    count = min(len(ours), len(theirs))
    a, b = ours[:count].reshape(-1, 3), theirs[:count].reshape(-1, 3)
    both = np.isfinite(a).all(1) & np.isfinite(b).all(1)
    fit = similarity(a[both], b[both])
    moved = fit.scale * a[both] @ fit.R_target_from_source.T + fit.t_target
    distance = 1000 * np.linalg.norm(moved - b[both], axis=1)
    print(
        f"after one similarity (scale {fit.scale:.3f}): mean {distance.mean():.1f} mm, median "
        f"{np.median(distance):.1f} mm over {both.sum()} points"
    )


if __name__ == "__main__":
    main()

"""Calibrate the simulated estimator's two parameters: ``python tools/calibrate_estimator.py DATA``.

Target: on the five `protocol` clips, four cameras each, the 12-joint errors of HMMR on Human3.6M.
The motions are the Carnegie Mellon University motion capture database's (mocap.cs.cmu.edu, NSF
EIA-0196217).
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from benchmarks.synthetic.captured import CAMERA_PLACEMENTS, place_camera, to_scene
from benchmarks.synthetic.simulated import EstimatorErrors, estimate
from imocap_core.conventions import EVAL_12
from imocap_core.metrics.position import mpjpe_mm, mpjpe_scaled_mm, pa_mpjpe_mm

TARGET_MM = (109.80, 78.26)  # HMMR in the paper's Table 2: MPJPE, P-MPJPE
SIZE = (1000, 1000)
SEEDS = (0, 1)


def camera_clips(data: Path) -> list[tuple[np.ndarray, float]]:
    """Every protocol clip in the axes of each of its four cameras, and its frame rate."""
    clips = []
    for path in sorted((data / "protocol").glob("*.npz")):
        with np.load(path) as stored:
            joints = stored["joints"][:, stored["common14_idx"]].astype(float)
            fps = float(stored["fps"])
        turn, shift = to_scene(joints)
        world = turn.apply(joints.reshape(-1, 3)).reshape(joints.shape) + shift
        for view in CAMERA_PLACEMENTS:
            _, R, t = place_camera(view, world, SIZE)
            clips.append((world @ R.T + t, fps))
    return clips


def errors_mm(
    clips: list[tuple[np.ndarray, float]], errors: EstimatorErrors, seeds: Sequence[int] = SEEDS
) -> np.ndarray:
    """MPJPE, P-MPJPE and scaled MPJPE (clips x seeds, 3), of every fourth frame."""
    rows = []
    for number, (joints, fps) in enumerate(clips):
        hips = joints[:, [EVAL_12.index("left_hip"), EVAL_12.index("right_hip")]].mean(1)
        true = (joints - hips[:, None])[::4, : len(EVAL_12)]
        for seed in seeds:
            rng = np.random.default_rng((seed, number))
            estimated = estimate(joints, fps, rng, errors)[::4, : len(EVAL_12)]
            rows.append([f(estimated, true) for f in (mpjpe_mm, pa_mpjpe_mm, mpjpe_scaled_mm)])
    return np.array(rows)


def main() -> None:
    """Solve, and print the parameters and their errors."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path, help="folder that contains protocol/")
    parser.add_argument("--check", action="store_true", help="only print the current errors")
    arguments = parser.parse_args()
    clips = camera_clips(arguments.data)
    base = EstimatorErrors()

    def settings(x: np.ndarray) -> EstimatorErrors:
        return replace(base, joint_m=float(x[0]), orientation_rad=float(x[1]))

    x = np.array([base.joint_m, base.orientation_rad])
    if not arguments.check:
        x = least_squares(
            lambda x: errors_mm(clips, settings(x)).mean(0)[:2] - TARGET_MM,
            x, diff_step=0.02, bounds=([0.01, 0.0], [0.3, 1.0]), xtol=1e-4,
        ).x  # fmt: skip
    rows = errors_mm(clips, settings(x))
    mean, error = rows.mean(0), rows.std(0) / np.sqrt(len(rows))
    print(f"joint_m = {x[0]:.4f}, orientation_rad = {x[1]:.4f}")
    for name, m, e in zip(("MPJPE", "P-MPJPE", "scaled MPJPE"), mean, error, strict=True):
        print(f"{name:<13} {m:6.2f} +- {e:.2f} mm over {len(rows)} clips, cameras and seeds")


if __name__ == "__main__":
    main()

"""Fit the standard deviation of a joint's speed (`biomechanics/events.py`) on training clips:
python -m tools.fit_speed_spread FOLDER

Performances of the clips of `tools/fit_joint_uncertainty.py` are solved as any action is (in
FOLDER, cached). The errors of the joints' speeds are taken as normal, with the variance

    (a sd)^2 + (b speed)^2

where sd is that of the joint's place along its path, and a and b are those of the largest
likelihood, each clip with the same weight. Frames slower than `LEAST_M_S` do not count.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

import imocap
from benchmarks.actions.action_folder import make_action
from benchmarks.parallel import LineDisplay
from imocap_core.biomechanics.events import speed_spreads_m_s, speeds_m_s
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.io.truth import read_truth
from imocap_core.pipeline import runner
from imocap_core.result.video_motion import FAST_JOINTS
from imocap_core.workspace import Workspace
from tools.fit_joint_uncertainty import PERFORMED, SEED, STAGES, performed_videos

LEAST_M_S = 0.3
# Performed with jumps of its own speed that no fit follows: 0.9 to 4.3 m/s within half a second
LEFT_OUT = "07_12"

Rows = Float[np.ndarray, "n 3"]  # error of the speed, sd of the place along the path, speed


def rows_of(folder: Path, name: str) -> Rows:
    """Errors of all joints of an action's videos, m/s, m, m/s."""
    result = imocap.load(folder / "artifacts" / name).levelled("y")
    frames = {video.id: np.asarray(video.frames) for video in result}
    truth = read_truth(folder / "actions" / name / "truth.npz", frames)
    rows = []
    for video in result:
        true, covariance = truth.videos[video.id], video.covariance_mm2
        assert true.joints is not None
        assert covariance is not None
        for joint in set(FAST_JOINTS) & set(true.joint_names):
            path = video.joint(joint)
            speed = speeds_m_s(path, video.fps)
            error = speed - speeds_m_s(true.joints[:, true.joint_names.index(joint)], video.fps)
            of_joint = covariance[:, SMPL_JOINTS.index(joint)]
            place = speed_spreads_m_s(path, of_joint, video.fps, 1.0, 0.0)
            rows.append(np.stack([error, place, speed], axis=1)[speed > LEAST_M_S])
    together = np.concatenate(rows)
    return np.asarray(together[np.isfinite(together).all(axis=1)])


def variance(rows: Rows, per_s: float, share: float) -> Float[np.ndarray, " n"]:
    return np.asarray((per_s * rows[:, 1]) ** 2 + (share * rows[:, 2]) ** 2)


def fitted(clips: list[Rows]) -> tuple[float, float]:
    """a and b of the largest likelihood."""

    def loss(logarithms: np.ndarray) -> float:
        spreads = [variance(rows, *np.exp(logarithms)) for rows in clips]
        return float(
            sum(
                np.mean(np.log(v) + rows[:, 0] ** 2 / v)
                for rows, v in zip(clips, spreads, strict=True)
            )
        )

    a, b = np.exp(minimize(loss, np.log([4.0, 0.1]), method="Nelder-Mead").x)
    return float(a), float(b)


def main() -> None:
    """Solve, fit, print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    folder, clips = parser.parse_args().folder, {}
    for clip in PERFORMED:
        name = f"perf-{clip}-{SEED}"
        videos = performed_videos(clip)
        action, display = folder / "actions" / name, LineDisplay()
        make_action(action, name, lambda videos=videos: videos, "fine_tuned", {}, name)
        job = Workspace(folder).ready_job(str(action), [], display)
        list(runner.run(job, display, [*STAGES, "uncertainty", "hands"]))
        clips[clip] = rows_of(folder, name)
    a, b = fitted([rows for clip, rows in clips.items() if clip != LEFT_OUT])
    print(f"sd of a speed: {a:.2f} 1/s of the place's, {100 * b:.1f} % of the speed")
    for clip, rows in clips.items():
        error = np.sqrt((rows[:, 0] ** 2 / variance(rows, a, b)).mean())
        print(f"{clip}: normalised error {error:.2f}{' (not fitted)' * (clip == LEFT_OUT)}")


if __name__ == "__main__":
    main()

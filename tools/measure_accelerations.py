"""Accelerations of joints in real motion: ``python tools/measure_accelerations.py DATA/train/...``.

Student's t in three dimensions, fitted to the accelerations of captured joints by maximum
likelihood: the constants of `imocap_core.motion.terms.smoothness`.
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.special import gammaln

from benchmarks.synthetic.captured_skeleton import CapturedSkeleton, captured_skeleton

FPS = 30.0
STARTS = {"hip": "knee", "shoulder": "elbow"}  # joints at the near end of the bone that ends there
ENDS = ("knee", "ankle", "elbow", "wrist")


def captured_joints(skeleton: CapturedSkeleton) -> dict[str, list[str]]:
    """Kind of joint -> the captured joints of that kind."""
    near = {kind: [skeleton.bones[f"{s}_{far}"][0] for s in ("left", "right")]
            for kind, far in STARTS.items()}  # fmt: skip
    far = {end: [skeleton.bones[f"{s}_{end}"][1] for s in ("left", "right")] for end in ENDS}
    return {**near, **far, "head": [skeleton.head]}


def student_t(lengths: np.ndarray) -> tuple[float, float]:
    """Scale and degrees of freedom of a centred Student's t in space, from vectors' lengths."""

    def cost(parameters: np.ndarray) -> float:
        log_scale, log_freedom = parameters
        freedom = np.exp(log_freedom)
        tail = (freedom + 3) / 2 * np.log1p(lengths**2 / (freedom * np.exp(2 * log_scale)))
        constant = gammaln((freedom + 3) / 2) - gammaln(freedom / 2)
        constant -= 1.5 * np.log(freedom * np.pi) + 3 * log_scale
        return float((tail - constant).mean())

    scale, freedom = np.exp(minimize(cost, [1.0, 1.0], method="Nelder-Mead").x)
    return float(scale), float(freedom)


def main() -> None:
    """Read the training clips and print a row for each kind of joint."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("train", type=Path, help="npz with clip_<id> (T, 27, 3) at 30 frames/s")
    arguments = parser.parse_args()
    with np.load(arguments.train) as stored:
        names, parents = [str(n) for n in stored["names"]], stored["parents"].tolist()
        clips = [
            stored[k].astype(float)
            for k in stored.files
            if k.startswith("clip_") and k != "clip_ids"
        ]
    for kind, joints in captured_joints(captured_skeleton(names, parents)).items():
        rows = [names.index(joint) for joint in joints]
        bends = [np.diff(clip[:, rows], 2, axis=0) * FPS**2 for clip in clips]
        lengths = np.concatenate([np.linalg.norm(b, axis=-1).ravel() for b in bends])
        scale, freedom = student_t(lengths)
        print(f"{kind:10s} scale {scale:.2f} m/s^2, degrees of freedom {freedom:.2f}")


if __name__ == "__main__":
    main()

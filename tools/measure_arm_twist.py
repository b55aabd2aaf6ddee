"""How upper arms are turned about themselves: ``python tools/measure_arm_twist.py DATA/train/...``.

The forearm of a bent elbow tells it. The constants in benchmarks/synthetic/captured_skeleton.py
are these means (circular) by the arm's elevation, right arms mirrored.
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.stats import circmean, circstd

from benchmarks.synthetic.captured_skeleton import (
    CapturedSkeleton,
    NeutralStance,
    captured_skeleton,
    neutral_stance,
    rotations_from_stance,
    shortest_rotations,
)

BENT_DEG = 40.0
BAND_DEG = 30.0
FEWEST = 50  # frames of a band
LEFT, FORWARD = np.eye(3)[0], np.eye(3)[2]
SIDES = (("left", np.ones(3)), ("right", np.array([-1.0, 1.0, 1.0])))


def arm_twists_deg(
    skeleton: CapturedSkeleton, stance: NeutralStance, xyz: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Elevations and twists of both upper arms in the frames in which their elbows are bent."""
    chest = rotations_from_stance(skeleton, stance, xyz)[1]
    elevations, twists = [], []
    for side, mirror in SIDES:
        upper, fore = (
            mirror * np.einsum("tji,tj->ti", chest, skeleton.bone(xyz, f"{side}_{end}"))
            for end in ("elbow", "wrist")
        )
        across = fore - (fore * upper).sum(-1, keepdims=True) * upper
        bent = np.degrees(np.arcsin(np.minimum(np.linalg.norm(across, axis=-1), 1.0))) > BENT_DEG
        untwisted = shortest_rotations(LEFT, upper) @ FORWARD  # where a T-pose's elbow would bend
        sine = (np.cross(untwisted, across) * upper).sum(-1)
        twist = np.degrees(np.arctan2(sine, (untwisted * across).sum(-1)))
        elevations.append(np.degrees(np.arcsin(upper[:, 1]))[bent])
        twists.append(twist[bent])
    return np.concatenate(elevations), np.concatenate(twists)


def main() -> None:
    """Read the training clips and print a row for each band of elevation."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("train", type=Path, help="npz with clip_<id> (T, 27, 3) at 30 frames/s")
    arguments = parser.parse_args()
    with np.load(arguments.train) as stored:
        names, parents = [str(n) for n in stored["names"]], stored["parents"].tolist()
        keys = [k for k in stored.files if k.startswith("clip_") and k != "clip_ids"]
        clips = [stored[k].astype(float) for k in keys]
    skeleton = captured_skeleton(names, parents)
    stance = neutral_stance(skeleton, clips)
    parts = [arm_twists_deg(skeleton, stance, clip) for clip in clips]
    elevation, twist = (np.concatenate(x) for x in zip(*parts, strict=True))
    for low in np.arange(-90.0, 90.0, BAND_DEG):
        band = twist[(elevation >= low) & (elevation < low + BAND_DEG)]
        if len(band) >= FEWEST:
            mean = circmean(band, high=180.0, low=-180.0)
            spread = circstd(band, high=180.0, low=-180.0)
            print(
                f"elevation {low + BAND_DEG / 2:4.0f} deg: twist {mean:5.0f}, spread {spread:3.0f}"
            )


if __name__ == "__main__":
    main()

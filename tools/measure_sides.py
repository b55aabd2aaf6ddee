"""How well left-right swaps are repaired: the table of docs/people.md.

``python tools/measure_sides.py DATA/train/cmu_train.npz``: training clips in four made cameras,
detections with limbs swapped in runs of three frames, and the same detections without.
"""

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.sync.training_scenes import training_clip
from imocap_core.camera.projection import project
from imocap_core.people.sides import limbs_of, swap_sides, swapped_frames
from imocap_core.synthetic.captured import (
    CAMERA_PLACEMENTS,
    COCO18,
    coco18_points,
    hip_middle,
    place_camera,
    stature_m,
)
from imocap_core.synthetic.detector import Detections, DetectorErrors, detect

CLIPS = ("02_05", "02_10", "05_06", "06_12", "12_02", "13_30", "13_01", "02_04", "05_18", "07_04")
LEVELS = {"exact": (1e-6, 0.0, 0.0), "fine_tuned": (4 / 600, 0.02, 0.02),
          "generic": (8 / 600, 0.05, 0.05)}  # fmt: skip
BOUTS = 0.02  # share of a limb's frames
SIZE_SHARE = 0.8  # of the standing height: about what a box around the points measures
CLEAR = 0.08  # of the height: closer sides cannot be told apart, nor need they


@dataclass
class Count:
    """Frames of limbs."""

    put_back: int = 0
    without_need: int = 0
    missed: int = 0
    touched: int = 0
    untroubled: int = 0


def seen(found: Detections, hidden: np.ndarray) -> np.ndarray:
    """(T, 18, 2), NaN where nothing was detected."""
    known = (found.confidence > 0) & ~hidden
    return np.where(known[..., None], found.xy_px, np.nan)


def measure(file: Path, level: str, step: int) -> tuple[Count, float, float]:
    """One row of the table: counts, mean error in swapped_frames frames before and after."""
    noise, outliers, misses = LEVELS[level]
    errors = DetectorErrors(noise=noise, outlier_rate=outliers, miss_rate=misses, swap_rate=BOUTS)
    count, before, after = Count(), [], []
    for number, clip in enumerate(CLIPS):
        joints = training_clip(file, clip)[::step]
        for v, view in enumerate(CAMERA_PLACEMENTS):
            K, R, t = place_camera(view, joints, (1000, 1000))
            true = project(coco18_points(joints), K, R, t)
            height = K[0, 0] * stature_m(joints) / (hip_middle(joints) @ R.T + t)[:, 2]
            swapped, plain = (
                detect(np.nan_to_num(true), height, COCO18, 30.0 / step,
                       np.random.default_rng([number, v, 1]), replace(errors, swap_rate=rate))
                for rate in (BOUTS, 0.0)
            )  # fmt: skip
            hidden = np.isnan(true).any(-1)
            xy = seen(swapped, hidden)
            for pairs in limbs_of(COCO18)[:2]:
                ends = np.array(pairs)
                moved = np.abs(np.nan_to_num(swapped.xy_px - plain.xy_px)).max(-1)
                wrong = moved[:, ends.ravel()].max(1) > 1e-9
                apart = np.linalg.norm(true[:, ends[:, 0]] - true[:, ends[:, 1]], axis=-1).max(1)
                found = swapped_frames(xy, SIZE_SHARE * height, pairs, 30.0 / step)
                count.put_back += int((found & wrong).sum())
                count.without_need += int((found & ~wrong).sum())
                count.missed += int((wrong & (apart > CLEAR * height) & ~found).sum())
                count.touched += int(
                    swapped_frames(
                        seen(plain, hidden), SIZE_SHARE * height, pairs, 30.0 / step
                    ).sum()
                )
                count.untroubled += len(xy)
                again, _ = swap_sides(xy, swapped.confidence, found, pairs)
                if wrong.any():
                    for kept, points in ((before, xy), (after, again)):
                        away = np.linalg.norm(points - true, axis=-1)[:, ends.ravel()][wrong]
                        kept.append(np.nanmean(away) / height.mean())
    return count, float(np.nanmean(before)), float(np.nanmean(after))


def main() -> None:
    """Print the table's rows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("train", type=Path, help="npz with clip_<id> (T, 27, 3) at 30 frames/s")
    arguments = parser.parse_args()
    for level in LEVELS:
        for step in (1, 2):
            c, before, after = measure(arguments.train, level, step)
            print(
                f"| {level} | {30 // step} | {c.put_back} | {c.missed} | {c.without_need} "
                f"| {c.touched} of {c.untroubled:,} | {before:.3f} / {after:.3f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()

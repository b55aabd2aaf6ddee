"""How well left-right swaps are repaired: the table of docs/people.md.

``python tools/measure_sides.py DATA/train/cmu_train.npz``: training clips in four made cameras,
detections with limbs swapped in runs of three frames, and the same detections without.
"""

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.sync_scenes import training_clip
from benchmarks.synthetic.captured import (
    CAMERA_PLACEMENTS,
    COCO18,
    coco18_points,
    hip_middle,
    place_camera,
    stature_m,
)
from imocap_core.camera.projection import project
from imocap_core.people.left_right import limbs_of, swap_sides, swapped_frames
from imocap_core.synthetic.detector import Detections, DetectorErrors, detect

CLIPS = ("02_05", "02_10", "05_06", "06_12", "12_02", "13_30", "13_01", "02_04", "05_18", "07_04")
DETECTOR_NOISE = {"exact": (1e-6, 0.0, 0.0), "fine_tuned": (4 / 600, 0.02, 0.02),
                  "generic": (8 / 600, 0.05, 0.05)}  # fmt: skip  # noise, outliers, misses
SWAP_RATE = 0.02  # share of a limb's frames
SIZE_SHARE = 0.8  # of the standing height: about the size of a box around the points
CLEAR = 0.08  # of the height: closer sides cannot be distinguished, nor is it necessary


@dataclass
class LimbFrames:
    """Counts of frames of limbs: with swaps, and (changed of `unswapped`) in clips without any."""

    repaired: int = 0
    missed: int = 0
    changed_wrongly: int = 0
    changed: int = 0
    unswapped: int = 0


def detected(detections: Detections, hidden: np.ndarray) -> np.ndarray:
    """(T, 18, 2), NaN where nothing was detected."""
    visible = (detections.confidence > 0) & ~hidden
    return np.where(visible[..., None], detections.xy_px, np.nan)


def measure(file: Path, detector: str, step: int) -> tuple[LimbFrames, float, float]:
    """One row of the table: counts, mean error in swapped frames before and after the repair."""
    noise, outliers, misses = DETECTOR_NOISE[detector]
    errors = DetectorErrors(
        noise=noise, outlier_rate=outliers, miss_rate=misses, swap_rate=SWAP_RATE
    )
    count, before, after = LimbFrames(), [], []
    for number, clip in enumerate(CLIPS):
        joints = training_clip(file, clip)[::step]
        for v, view in enumerate(CAMERA_PLACEMENTS):
            K, R, t = place_camera(view, joints, (1000, 1000))
            true = project(coco18_points(joints), K, R, t)
            height = K[0, 0] * stature_m(joints) / (hip_middle(joints) @ R.T + t)[:, 2]
            swapped, plain = (
                detect(np.nan_to_num(true), height, COCO18, 30.0 / step,
                       np.random.default_rng([number, v, 1]), replace(errors, swap_rate=rate))
                for rate in (SWAP_RATE, 0.0)
            )  # fmt: skip
            hidden = np.isnan(true).any(-1)
            xy, unswapped = detected(swapped, hidden), detected(plain, hidden)
            for pairs in limbs_of(COCO18)[:2]:
                ends = np.array(pairs)
                moved = np.abs(np.nan_to_num(swapped.xy_px - plain.xy_px)).max(-1)
                wrong = moved[:, ends.ravel()].max(1) > 1e-9
                apart = np.linalg.norm(true[:, ends[:, 0]] - true[:, ends[:, 1]], axis=-1).max(1)
                size, fps = SIZE_SHARE * height, 30.0 / step
                frames = swapped_frames(xy, size, pairs, fps)
                count.repaired += int((frames & wrong).sum())
                count.changed_wrongly += int((frames & ~wrong).sum())
                count.missed += int((wrong & (apart > CLEAR * height) & ~frames).sum())
                count.changed += int(swapped_frames(unswapped, size, pairs, fps).sum())
                count.unswapped += len(xy)
                repaired, _ = swap_sides(xy, swapped.confidence, frames, pairs)
                if wrong.any():
                    for means, points in ((before, xy), (after, repaired)):
                        error = np.linalg.norm(points - true, axis=-1)[:, ends.ravel()][wrong]
                        means.append(np.nanmean(error) / height.mean())
    return count, float(np.nanmean(before)), float(np.nanmean(after))


def main() -> None:
    """Print the table's rows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("train", type=Path, help="npz with clip_<id> (T, 27, 3) at 30 frames/s")
    arguments = parser.parse_args()
    for detector in DETECTOR_NOISE:
        for step in (1, 2):
            c, before, after = measure(arguments.train, detector, step)
            print(
                f"| {detector} | {30 // step} | {c.repaired} | {c.missed} | {c.changed_wrongly} "
                f"| {c.changed} of {c.unswapped:,} | {before:.3f} / {after:.3f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()

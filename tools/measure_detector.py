"""A detector's errors on rendered videos:

    python -m tools.measure_detector DATA/train/cmu_train.npz --work FOLDER [--detector NAME]

Two seconds of training clips on the free body, rendered from four cameras as `imocap benchmark
rendered` does with `trials`, and detected. Prints the detector's errors, and below each the same of
the simulated detector `mediapipe` (benchmarks/synthetic/simulated.py) on the same videos.
Measured videos are cached in FOLDER.
"""

import argparse
from pathlib import Path

import cv2
import numpy as np
import torch

from benchmarks.detection_errors import (
    DetectedClip,
    detector_bias,
    swapped_body_share,
    swapped_share,
)
from benchmarks.rendered_action import true_points
from benchmarks.sync_scenes import CAPTURED_FPS
from benchmarks.synthetic.captured import CAMERA_PLACEMENTS
from benchmarks.synthetic.films import film_motion
from benchmarks.synthetic.retargeting import perform
from benchmarks.synthetic.simulated import DETECTORS
from imocap_core.body import load_free_body
from imocap_core.conventions import OTHER
from imocap_core.detect.detectors import Detector, detector_of
from imocap_core.params import DetectParams
from imocap_core.synthetic.detector import detect
from tools.training_films import SIZE, TrainingClips, detected_landmarks

CLIPS = ("02_05", "03_02", "05_02", "05_18", "06_12", "07_04", "10_04", "13_09")
FRAMES = 64
SEED = 7
TARGETS = {"nose": "", "eye": "", "ear": "", "shoulder": "elbow", "elbow": "shoulder",
           "wrist": "elbow", "hip": OTHER, "knee": "", "ankle": "knee", "heel": "knee",
           "foot_index": "heel"}  # fmt: skip
LIMBS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
TURNED = 0.05  # of the height
DRAWS = 4  # of the simulated detector
ROOT = Path(__file__).parents[1]


def measure(train: Path, clip: str, view: int, detector: Detector) -> dict[str, np.ndarray]:
    """One video: its ground truth (`true_points`), the detected points (T, 33, 2), NaN where nobody
    was detected, and the detector's confidence (T, 33)."""
    clips, model = TrainingClips.read(train), load_free_body(dtype=torch.float64)
    joints = clips.joints[clip]
    first = max(0, (len(joints) - FRAMES) // 2)
    moved = [joints[first : first + FRAMES]]
    betas, motions = perform(model, clips.skeleton, clips.stance, moved)
    shaped = model.shape(torch.as_tensor(betas))
    filmed = film_motion(motions[0], shaped, CAMERA_PLACEMENTS[view], SIZE)
    landmarks = detected_landmarks(filmed, shaped, view, SEED + CLIPS.index(clip), detector)
    true = true_points(filmed, shaped)
    detected_px = landmarks[:, true["columns"], :2] * SIZE
    return true | {"detected_px": detected_px, "trust": landmarks[:, true["columns"], 3]}


def films(train: Path, work: Path, detector: Detector) -> list[dict[str, np.ndarray]]:
    """All videos; those in the folder `work` are not made again."""
    work.mkdir(parents=True, exist_ok=True)
    every = []
    for clip in CLIPS:
        for view in range(len(CAMERA_PLACEMENTS)):
            file = work / f"{clip}_{view}_{detector.name}.npz"
            if not file.exists():
                np.savez(file, **measure(train, clip, view, detector))
                print(f"{clip}, camera {view + 1}", flush=True)
            with np.load(file) as stored:
                every.append(dict(stored))
    return every


def simulated(film: dict[str, np.ndarray], names: list[str], seed: list[int]) -> DetectedClip:
    """Simulated detections of the same video."""
    errors, rng = DETECTORS["mediapipe"], np.random.default_rng(seed)
    true_names = [name.replace("foot_index", "big_toe") for name in names]
    d = detect(film["xy_px"], film["height_px"], true_names, CAPTURED_FPS, rng, errors)
    xy = np.where(d.confidence[..., None] > 0, d.xy_px, np.nan)
    return DetectedClip(xy, film["xy_px"], film["height_px"], str(film["side"]), CAPTURED_FPS)


def report(every: list[dict[str, np.ndarray]]) -> None:
    """Errors of the detector by keypoint and, below, of its simulation; then of all keypoints."""
    names = [str(name) for name in every[0]["names"]]
    real = [DetectedClip(f["detected_px"], f["xy_px"], f["height_px"], str(f["side"]), CAPTURED_FPS)
            for f in every]  # fmt: skip
    made = [simulated(f, names, [n, k]) for n, f in enumerate(every) for k in range(DRAWS)]
    kinds = ((kind, target, who, clips) for kind, target in TARGETS.items()
             for who, clips in (("measured", real), ("simulated", made)))  # fmt: skip
    for kind, target, who, clips in kinds:
        h = detector_bias(clips, names, kind, target)
        print(f"{kind:10} {who:9} {100 * h.share:5.1f} % towards {target or '-':9} "
              f"lasting {100 * h.lasting:.2f} spread {100 * h.spread:.2f} "
              f"for {h.persistence_s:.2f} s outliers {100 * h.outlier_rate:4.1f} % of "
              f"{100 * h.outlier_size:4.1f} for {h.outlier_s:.2f} s")  # fmt: skip
    body = [k for k, name in enumerate(names) if name.split("_", 1)[-1] in LIMBS]
    for who, clips in (("measured", real), ("simulated", made)):
        for side in ("", "front", "side", "back"):
            chosen = [f for f in clips if side in ("", f.side)]
            errors = [np.linalg.norm(f.error[:, body], axis=-1).ravel() for f in chosen]
            quantiles = np.nanquantile(np.concatenate(errors), (0.25, 0.5, 0.75, 0.9, 0.95, 0.99))
            print(f"{who} {side or 'all'}, {len(chosen)} films:", np.round(100 * quantiles, 2))
        swaps = [np.nanmean([swapped_share(f, names, part) for f in clips])
                 for part in ("arm", "leg")]  # fmt: skip
        turned = np.nanmean([swapped_body_share(f, names, TURNED) for f in clips])
        missed = np.mean([np.isnan(f.detected_px[:, body]).any(axis=-1).mean() for f in clips])
        print(f"{who}: arms swapped {100 * swaps[0]:.2f} %, legs {100 * swaps[1]:.2f} %, "
              f"body {100 * turned:.2f} %; missed {100 * missed:.2f} %")  # fmt: skip


def main() -> None:
    """Render, detect, print the errors."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("train", type=Path, help="npz with clip_<id> (T, 27, 3) at 30 frames/s")
    parser.add_argument("--work", type=Path, required=True, help="films that were measured")
    parser.add_argument("--detector", choices=("mediapipe", "blazepose"), default="mediapipe")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    detector = detector_of(DetectParams(detector=arguments.detector), ROOT)
    report(films(arguments.train, arguments.work, detector))


if __name__ == "__main__":
    main()

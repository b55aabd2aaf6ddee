"""MediaPipe's errors on films: `tools/measure_detector.py DATA/train/cmu_train.npz --work FOLDER`.

Two seconds of training clips on the free body, filmed by four cameras as `imocap benchmark
rendered` films performances of `trials`, found by the detector. Prints its habits, and below each
the same of the simulated detector `mediapipe` (imocap_core/synthetic/detector_presets.py) on the
same films. Films that were measured are not measured again.
"""

import argparse
import tempfile
from pathlib import Path

import cv2
import numpy as np
import torch

from benchmarks.rendered.action import true_points
from benchmarks.sync.training_scenes import CAPTURED_FPS, training_clip
from imocap_core.body import load_free_body
from imocap_core.conventions import OTHER
from imocap_core.detect.detection import detect_video
from imocap_core.detect.detectors import detector_of
from imocap_core.detect.environment import python_for
from imocap_core.io.video import write_h264
from imocap_core.metrics.detections import DetectedClip, exchanged_share
from imocap_core.metrics.detector_bias import detector_bias, exchanged_body_share
from imocap_core.params import DetectParams
from imocap_core.synthetic.captured import CAMERA_PLACEMENTS
from imocap_core.synthetic.detector import detect
from imocap_core.synthetic.detector_presets import DETECTORS
from imocap_core.synthetic.rendered import film_body, render_frames
from imocap_core.synthetic.retarget import retarget

CLIPS = ("02_05", "03_02", "05_02", "05_18", "06_12", "07_04", "10_04", "13_09")
FRAMES = 64
SIZE, CRF, SEED = (640, 480), 20, 7
TARGETS = {"nose": "", "eye": "", "ear": "", "shoulder": "elbow", "elbow": "shoulder",
           "wrist": "elbow", "hip": OTHER, "knee": "", "ankle": "knee", "heel": "knee",
           "foot_index": "heel"}  # fmt: skip
LIMBS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
TURNED = 0.05  # of the height
DRAWS = 4  # of the simulated detector
ROOT = Path(__file__).parents[1]


def measure(train: Path, clip: str, view: int, python: Path) -> dict[str, np.ndarray]:
    """One film: what is true of it (`true_points`), where its points were found (T, 33, 2), NaN
    where nobody was, and the detector's own trust (T, 33)."""
    joints = training_clip(train, clip)
    first = max(0, (len(joints) - FRAMES) // 2)
    model = load_free_body(dtype=torch.float64)
    betas, motions = retarget(model, [joints[first : first + FRAMES]])
    shaped = model.shape(torch.as_tensor(betas))
    filmed = film_body(motions[0], shaped, CAMERA_PLACEMENTS[view], SIZE)
    detector = detector_of(DetectParams(), ROOT)
    with tempfile.TemporaryDirectory() as folder:
        video, found = Path(folder) / "film.mp4", Path(folder) / "found.npz"
        pictures = render_frames(filmed, shaped, view, SEED + CLIPS.index(clip))
        write_h264(video, pictures, CAPTURED_FPS, crf=CRF)
        detect_video(video, found, detector, python, lambda share, what: None)
        with np.load(found) as stored:
            landmarks = stored["pose_landmarks"]
    seen = true_points(filmed, shaped)
    found_px, trust = landmarks[:, seen["columns"], :2] * SIZE, landmarks[:, seen["columns"], 3]
    return seen | {"found_px": found_px, "trust": trust}


def films(train: Path, work: Path, python: Path) -> list[dict[str, np.ndarray]]:
    """All films; those that `work` holds are not made again."""
    work.mkdir(parents=True, exist_ok=True)
    every = []
    for clip in CLIPS:
        for view in range(len(CAMERA_PLACEMENTS)):
            file = work / f"{clip}_{view}.npz"
            if not file.exists():
                np.savez(file, **measure(train, clip, view, python))
                print(f"{clip}, camera {view + 1}", flush=True)
            with np.load(file) as stored:
                every.append(dict(stored))
    return every


def simulated(found: dict[str, np.ndarray], names: list[str], seed: list[int]) -> DetectedClip:
    """The same film as the simulated level sees it."""
    level, rng = DETECTORS["mediapipe"], np.random.default_rng(seed)
    asked = [name.replace("foot_index", "big_toe") for name in names]
    d = detect(found["xy_px"], found["height_px"], asked, CAPTURED_FPS, rng, level)
    xy = np.where(d.confidence[..., None] > 0, d.xy_px, np.nan)
    return DetectedClip(xy, found["xy_px"], found["height_px"], str(found["side"]), CAPTURED_FPS)


def report(every: list[dict[str, np.ndarray]]) -> None:
    """Habits of the detector and, below, of its simulation; then how far all points are off."""
    names = [str(name) for name in every[0]["names"]]
    real = [DetectedClip(f["found_px"], f["xy_px"], f["height_px"], str(f["side"]), CAPTURED_FPS)
            for f in every]  # fmt: skip
    made = [simulated(f, names, [n, k]) for n, f in enumerate(every) for k in range(DRAWS)]
    kinds = ((kind, target, who, seen) for kind, target in TARGETS.items()
             for who, seen in (("measured", real), ("simulated", made)))  # fmt: skip
    for kind, target, who, seen in kinds:
        h = detector_bias(seen, names, kind, target)
        print(f"{kind:10} {who:9} {100 * h.share:5.1f} % towards {target or '-':9} "
              f"lasting {100 * h.lasting:.2f} spread {100 * h.spread:.2f} "
              f"for {h.persistence_s:.2f} s outliers {100 * h.outlier_rate:4.1f} % of "
              f"{100 * h.outlier_size:4.1f} for {h.outlier_s:.2f} s")  # fmt: skip
    body = [k for k, name in enumerate(names) if name.split("_", 1)[-1] in LIMBS]
    for who, seen in (("measured", real), ("simulated", made)):
        for side in ("", "front", "side", "back"):
            own = [f for f in seen if side in ("", f.side)]
            off = np.concatenate([np.linalg.norm(f.error[:, body], axis=-1).ravel() for f in own])
            told = 100 * np.nanquantile(off, (0.25, 0.5, 0.75, 0.9, 0.95, 0.99))
            print(f"{who} {side or 'all'}, {len(own)} films:", np.round(told, 2))
        swaps = [np.nanmean([exchanged_share(f, names, part) for f in seen])
                 for part in ("arm", "leg")]  # fmt: skip
        turned = np.nanmean([exchanged_body_share(f, names, TURNED) for f in seen])
        missed = np.mean([np.isnan(f.detected_px[:, body]).any(axis=-1).mean() for f in seen])
        print(f"{who}: arms exchanged {100 * swaps[0]:.2f} %, legs {100 * swaps[1]:.2f} %, "
              f"body {100 * turned:.2f} %; missed {100 * missed:.2f} %")  # fmt: skip


def main() -> None:
    """DetectedClip, find, say how it errs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("train", type=Path, help="npz with clip_<id> (T, 27, 3) at 30 frames/s")
    parser.add_argument("--work", type=Path, required=True, help="films that were measured")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    environments = Path(__file__).parents[1] / "imocap_core" / "detect" / "environments"
    environment = environments / "mediapipe.txt"
    python = python_for(environment, ROOT.parent, print)
    report(films(arguments.train, arguments.work, python))


if __name__ == "__main__":
    main()

"""Where a detector marks joints, fitted to rendered films of training clips:

    python -m tools.fit_detector_marks DATA/train/cmu_train.npz --work FOLDER [--detector NAME]

Sixteen clips, each by a body of its own from four sides, rendered as `imocap benchmark rendered`
does and detected (cached in FOLDER). Each mark is a mix of points of the body: the shares that
bring its projection nearest to the detections are printed, of all films and of each half, with the
median and the 90th percentile of the distance without and with them. They stand in
imocap_core/body/data/layouts.toml.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import Float

from benchmarks.synthetic.films import film_motion
from benchmarks.synthetic.retargeting import RetargetedMotion, perform
from imocap_core.body import Model, load_free_body
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.detect.detectors import Detector, detector_of
from imocap_core.params import DetectParams
from imocap_core.synthetic.cameras import CameraPlacement
from tools.training_films import SIZE, TrainingClips, detected_landmarks

CLIPS = ("02_09", "02_10", "03_01", "05_07", "05_12", "06_10", "07_11", "10_04",
         "11_01", "12_02", "13_01", "13_08", "13_30", "13_34", "05_14", "01_01")  # fmt: skip
FRAMES, SPARE = 54, 12  # frames of a film; its start is drawn among the spare ones
VIEWS, SEED = 4, 77
SHAPE_SD = 0.8  # of the betas that are drawn
PLACES = "body33"  # the same keypoints at their places on the body
# The points towards which each mark may lie from its joint, or else from its place on the body.
# OTHER_ is the same joint of the other side.
MIXES = {
    "shoulder": ("neck",),
    "elbow": ("shoulder",),
    "wrist": ("elbow",),
    "hip": ("OTHER_hip", "knee", "spine1"),
    "knee": ("ankle",),
    "ankle": ("knee",),
    "heel": ("ankle",),
    "foot_index": ("ankle",),
}
ROBUST_M = 0.03  # scale of the Geman-McClure loss
ROUNDS = 30
ROOT = Path(__file__).parents[1]


@dataclass(frozen=True)
class DetectedFilm:
    """One film: detected points (T, 33, 2), pixels; the body's joints (T, 24, 3) and the points of
    PLACES (T, 33, 3), metres, camera axes; K."""

    detected_px: Float[np.ndarray, "T 33 2"]
    joints: Float[np.ndarray, "T 24 3"]
    places: Float[np.ndarray, "T 33 3"]
    K: Float[np.ndarray, "3 3"]


def films(train: Path, work: Path, detector: Detector) -> list[DetectedFilm]:
    """All films; those in the folder `work` are not made again."""
    work.mkdir(parents=True, exist_ok=True)
    every = []
    for number, clip in enumerate(CLIPS):
        for view in range(VIEWS):
            file = work / f"{clip}_{view}_{detector.name}.npz"
            if not file.exists():
                film_clip(train, work, number, detector)
                print(f"{clip} filmed", flush=True)
            with np.load(file) as stored:
                every.append(DetectedFilm(**dict(stored)))
    return every


def film_clip(train: Path, work: Path, number: int, detector: Detector) -> None:
    """One clip by a body of its own, seen from four sides a quarter of a turn apart."""
    rng, clip = np.random.default_rng([SEED, number]), CLIPS[number]
    clips, model = TrainingClips.read(train), load_free_body(dtype=torch.float64)
    moved = liveliest(clips.joints[clip], FRAMES + SPARE)
    betas, (motion,) = perform(model, clips.skeleton, clips.stance, [moved])
    shaped = model.shape(torch.as_tensor(0.5 * betas + rng.normal(0.0, SHAPE_SD, len(betas))))
    first_deg, count = rng.uniform(0.0, 90.0), min(FRAMES, len(moved) - SPARE)
    for view, start in enumerate(rng.permutation(VIEWS) * (SPARE // VIEWS)):
        part = slice(start, start + count)
        camera = CameraPlacement(
            first_deg + 360.0 / VIEWS * view + rng.uniform(-25.0, 25.0),
            rng.uniform(3.0, 6.0), rng.uniform(0.7, 2.2), rng.uniform(0.85, 1.3),
        )  # fmt: skip
        taken = RetargetedMotion(motion.R_local[part], motion.transl[part])
        filmed = film_motion(taken, shaped, camera, SIZE)
        landmarks = detected_landmarks(filmed, shaped, view, SEED + number, detector)
        on_floor = filmed.motion
        posed = shaped.pose(torch.as_tensor(on_floor.R_local), torch.as_tensor(on_floor.transl))
        places = posed.keypoints(model.points(PLACES)).numpy()
        np.savez(
            work / f"{clip}_{view}_{detector.name}.npz",
            detected_px=landmarks[..., :2] * SIZE,
            joints=filmed.joints @ filmed.R.T + filmed.t,
            places=places @ filmed.R.T + filmed.t,
            K=filmed.K,
        )


def liveliest(joints: Float[np.ndarray, "T J 3"], frames: int) -> Float[np.ndarray, "_ J 3"]:
    """The stretch of that many frames in which the joints move most."""
    speed = np.linalg.norm(np.diff(joints, axis=0), axis=-1).mean(axis=1)
    frames = min(frames, len(joints))
    moved = np.convolve(speed, np.ones(frames - 1), mode="valid")
    start = int(np.argmax(moved))
    return joints[start : start + frames]


def shares(
    every: Sequence[DetectedFilm], names: list[str], kind: str
) -> tuple[Float[np.ndarray, " n"], list[Float[np.ndarray, " 2"]]]:
    """The shares of a mark's mix (`MIXES`), and quantiles (0.5, 0.9) of the distance in metres, on
    the plane of the joint, without and with them."""
    towards, away = [], []
    for film in every:
        for side in ("left", "right"):
            column = names.index(f"{side}_{kind}")
            joint = f"{side}_{kind}" in SMPL_JOINTS
            place = _joint(film, side, kind) if joint else film.places[:, column]
            px = place[:, :2] / place[:, 2:] * film.K[[0, 1], [0, 1]] + film.K[:2, 2]
            metres = place[:, 2:] / film.K[0, 0]
            away.append((film.detected_px[:, column] - px) * metres)
            others = np.stack([_joint(film, side, name) for name in MIXES[kind]], axis=-1)
            offset = others - place[..., None]
            ray = place[:, :2] / place[:, 2:]
            towards.append(offset[:, :2] - ray[..., None] * offset[:, 2:])
    J, r = np.concatenate(towards), np.concatenate(away)
    detected = np.isfinite(r).all(axis=1)
    J, r = J[detected], r[detected]
    weight = np.ones(len(r))
    for _ in range(ROUNDS):
        solution = np.linalg.solve(
            np.einsum("t,tia,tib->ab", weight, J, J), np.einsum("t,tia,ti->a", weight, J, r)
        )
        left = np.linalg.norm(r - J @ solution, axis=1)
        weight = (1 + (left / ROBUST_M) ** 2) ** -2.0
    before = np.linalg.norm(r, axis=1)
    return solution, [np.quantile(distance, (0.5, 0.9)) for distance in (before, left)]


def _joint(film: DetectedFilm, side: str, name: str) -> Float[np.ndarray, "T 3"]:
    other = {"left": "right", "right": "left"}[side]
    name = name.replace("OTHER", other)
    full = name if name in SMPL_JOINTS else f"{side}_{name}"
    return film.joints[:, SMPL_JOINTS.index(full)]


def report(every: Sequence[DetectedFilm], model: Model) -> None:
    """Print the shares of every mark: of all films, and of those of each half of the clips."""
    names = list(model.points(PLACES).names)
    half = len(every) // 2
    for kind, mix in MIXES.items():
        of_all, (before, after) = shares(every, names, kind)
        halves = [shares(part, names, kind)[0] for part in (every[:half], every[half:])]
        fitted = ", ".join(
            f"{name} {share:+.3f} ({first:+.3f}, {second:+.3f})"
            for name, share, first, second in zip(mix, of_all, *halves, strict=True)
        )
        print(
            f"{kind:10} {1000 * before[0]:5.1f} / {1000 * before[1]:5.1f} mm -> "
            f"{1000 * after[0]:5.1f} / {1000 * after[1]:5.1f}: {fitted}"
        )


def main() -> None:
    """Film, detect, fit, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("train", type=Path, help="npz with clip_<id> (T, 27, 3) at 30 frames/s")
    parser.add_argument("--work", type=Path, required=True, help="films that were detected")
    parser.add_argument("--detector", choices=("mediapipe", "blazepose"), default="blazepose")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    detector = detector_of(DetectParams(detector=arguments.detector), ROOT)
    report(films(arguments.train, arguments.work, detector), load_free_body(dtype=torch.float64))


if __name__ == "__main__":
    main()

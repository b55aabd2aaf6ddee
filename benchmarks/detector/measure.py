"""The default detector on degraded footage, against a calibrated triangulation."""

from __future__ import annotations

import itertools
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from benchmarks.detector.degradations import DEGRADATIONS, PLAIN, Degradation, Picture
from benchmarks.detector.reference import LIMBS, SHIFTS, reference_limbs, shifted
from imocap_core.body.layouts import layout_names
from imocap_core.detect.detection import Worker, set_up, with_last
from imocap_core.detect.detectors import Detector, detector_of
from imocap_core.io.readers.mediapipe import LAYOUT, read_mediapipe
from imocap_core.io.video import probe, read_rgb
from imocap_core.params import DetectParams, KeypointsParams
from imocap_core.people.performer import performer_of, ranked_tracks
from imocap_core.pipeline.runner import Display

SEED = 1
STANDING = 0.82  # of a person's height: shoulders to ankles
FrameErrors = dict[str, np.ndarray | float]
FOLLOWED = 0.1  # of the height: with a smaller mean error the person was followed in that frame


@dataclass(frozen=True)
class DetectorScore:
    """One degradation of one action's videos.

    followed_pct: frames in which the person who was chosen is the performer. error_pct: mean error
    in these, of the height. pck_2, pck_1: share of the limb joints within .2, .1 of the torso.
    swapped: frames with left and right of the body swapped. people: mean number a frame. ms: a
    frame.
    """

    action: str
    footage: str
    frames: int
    followed_pct: float
    error_pct: float
    pck_2: float
    pck_1: float
    swapped: int
    people: float
    ms: float


@dataclass(frozen=True)
class PerformerLimbs:
    """The performer's limbs (T, 12, 2) in the frames that the detector got, pixels as filmed."""

    frames: np.ndarray
    limbs_px: Float[np.ndarray, "T 12 2"]
    people: float
    seconds: float


def measure(
    action: str, folder: Path, frames: int, chosen: tuple[str, ...], display: Display
) -> list[DetectorScore]:
    """Scores of an action's four videos, of the first `frames` frames of each, as filmed and
    degraded; `chosen`: names of the degradations, all when empty."""
    detector = detector_of(DetectParams(), folder)
    python = set_up(detector, lambda what: display.progress(0.0, what))
    videos = sorted((folder / "videos").glob("*.mp4"))
    shifts: dict[str, int] = {}
    scores = []
    for degradation in DEGRADATIONS:
        if chosen and degradation.name not in (*chosen, PLAIN.name):
            continue
        display.started(action, [degradation.title])
        rows = []
        for video in videos:
            limbs = reference_limbs(folder, video.stem, frames)
            result = detect(video, limbs, degradation, detector, python)
            if degradation is PLAIN:
                shifts[video.stem] = best_shift(result, limbs)
            rows.append(errors(result, shifted(limbs, shifts[video.stem])))
            rows[-1] |= {"people": result.people, "ms": 1000 * result.seconds / len(result.frames)}
        scores.append(score_of(action, degradation.title, rows))
    return scores


def detect(
    video: Path,
    limbs: Float[np.ndarray, "T 12 2"],
    degradation: Degradation,
    detector: Detector,
    python: Path,
) -> PerformerLimbs:
    """Run the detector on a degraded video and choose the performer."""
    answers: list[dict[str, Any]] = []
    numbers, seconds = [], 0.0
    with Worker(python, detector.worker, detector.arguments) as worker:
        for (number, picture), is_last in with_last(degraded(video, limbs, degradation)):
            begin = time.perf_counter()
            answers.append(worker.detect(picture, is_last))
            seconds += time.perf_counter() - begin
            numbers.append(number)
    info = probe(video)
    size = (round(info.size[0] * degradation.scale), round(info.size[1] * degradation.scale))
    with tempfile.TemporaryDirectory() as scratch:
        file = Path(scratch) / "detections.npz"
        np.savez(file, **detector.arrays(answers))  # type: ignore[arg-type]
        people = read_mediapipe(file, LAYOUT, size).people
    fps = info.fps * (1 - degradation.dropped)
    least = KeypointsParams().min_confidence
    ranked = ranked_tracks(people, size, fps, min_confidence=least)
    performer = performer_of(ranked, 0, people)
    columns = [layout_names(LAYOUT).index(name) for name in LIMBS]
    limbs_px = performer.xy_px[:, columns] / degradation.scale
    count = float(np.mean([len(in_frame) for in_frame in people]))
    return PerformerLimbs(np.array(numbers), limbs_px, count, seconds)


def degraded(
    video: Path, limbs: Float[np.ndarray, "T 12 2"], degradation: Degradation
) -> Iterator[tuple[int, Picture]]:
    """(frame number, picture) of those that are not dropped."""
    rng = np.random.default_rng(SEED)
    for number, picture in itertools.islice(read_rgb(video), len(limbs)):
        if rng.random() < degradation.dropped:
            continue
        change = degradation.picture
        passed = number / len(limbs)
        yield number, change(picture, limbs[number], passed) if change else picture


def best_shift(result: PerformerLimbs, limbs: Float[np.ndarray, "T 12 2"]) -> int:
    """By how many frames the reference fits best: the files agree within a few."""

    def distance(by: int) -> float:
        true = shifted(limbs, by)[result.frames]
        return float(np.nanmedian(np.linalg.norm(result.limbs_px - true, axis=-1)))

    return min(SHIFTS, key=distance)


def errors(result: PerformerLimbs, limbs: Float[np.ndarray, "T 12 2"]) -> FrameErrors:
    """Per frame and joint: error / height, error / torso; per frame: whether left and right are
    swapped. Frames without a reference are left out."""
    covered = np.isfinite(limbs[result.frames]).all(axis=(1, 2))
    true, xy = limbs[result.frames][covered], result.limbs_px[covered]
    height = np.percentile(np.ptp(true[..., 1], axis=1), 90) / STANDING
    middle = [true[:, [k, k + 6]].mean(axis=1) for k in (0, 3)]
    torso = float(np.median(np.linalg.norm(middle[0] - middle[1], axis=-1)))
    error = np.linalg.norm(xy - true, axis=-1)
    other_side = np.linalg.norm(np.roll(xy, 6, axis=1) - true, axis=-1)
    far = np.where(np.isfinite(error), error, np.inf)  # missed is wrong
    gain = np.nanmean(np.where(np.isfinite(error).any(axis=1)[:, None], error - other_side, 0), 1)
    return {"height": error / height, "torso": far / torso, "swapped": gain / height > 0.05}


def score_of(action: str, title: str, rows: list[FrameErrors]) -> DetectorScore:
    """One row of the table, of all videos."""
    height, torso, swapped = (
        np.concatenate([np.asarray(row[name]) for row in rows])
        for name in ("height", "torso", "swapped")
    )
    with np.errstate(invalid="ignore"):
        mean = np.array([np.nanmean(e) if np.isfinite(e).any() else np.inf for e in height])
    followed = mean < FOLLOWED
    return DetectorScore(
        action,
        title,
        len(height),
        100 * float(followed.mean()),
        100 * float(mean[followed].mean()) if followed.any() else float("nan"),
        100 * float((torso < 0.2).mean()),
        100 * float((torso < 0.1).mean()),
        int(swapped.sum()),
        float(np.mean([row["people"] for row in rows])),
        float(np.mean([row["ms"] for row in rows])),
    )

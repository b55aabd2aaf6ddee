"""`imocap benchmark detector`: the default detector on plain and on degraded footage."""

from __future__ import annotations

import itertools
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from rich.table import Table

from benchmarks.actions.captured_videos import data_folder
from benchmarks.names import BenchmarkOptions
from benchmarks.tables import cell, markdown_table, write_texts
from imocap_core.body.layouts import layout_names
from imocap_core.detect.detection import Worker, set_up, with_last
from imocap_core.detect.detectors import Detector, detector_of
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.io.readers.mediapipe import LAYOUT, read_mediapipe
from imocap_core.io.truth import read_pose2sim_truth
from imocap_core.io.video import probe, read_rgb
from imocap_core.params import DetectParams, KeypointsParams
from imocap_core.people.performer import performer_of, ranked_tracks
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace

# Degraded footage: what a detector has to cope with, made from real pictures.

Picture = UInt8[np.ndarray, "height width 3"]
Limbs = Float[np.ndarray, "12 2"]  # shoulder, elbow, wrist, hip, knee, ankle; left, then right
LEGS = [3, 4, 5, 9, 10, 11]
BLUR_SHARE = 0.02  # of the picture's larger side
PASTED_BESIDE = 0.7  # widths of the person's box, by which the second one stands beside
MARGIN = 0.1  # of the person's height, about the box of the limbs
DROPPED = 0.5
MIDDLE_THIRD = 1 / 3  # of the clip: where it begins


@dataclass(frozen=True)
class Degradation:
    """One kind of degraded footage.

    picture: of a picture, the performer's limbs in it and the share of the clip that has passed.
    scale: sides of the degraded picture / the plain one's. dropped: share of the frames left out.
    """

    name: str
    title: str
    picture: Callable[[Picture, Limbs, float], Picture] | None = None
    scale: float = 1.0
    dropped: float = 0.0


def hidden_legs(
    picture: Picture, limbs: Limbs, passed: float, begin: float = MIDDLE_THIRD
) -> Picture:
    """A black box over the legs in the third of the clip that begins where the share `begin` has
    passed."""
    if not begin <= passed < begin + 1 / 3:
        return picture
    (x0, y0), (x1, y1) = box_about(limbs[LEGS], 0.5 * MARGIN * np.ptp(limbs[:, 1]))
    hidden = picture.copy()
    hidden[max(y0, 0) : max(y1, 0), max(x0, 0) : max(x1, 0)] = 0
    return hidden


def motion_blur(picture: Picture, limbs: Limbs, passed: float) -> Picture:
    """The mean of the picture moved to the side."""
    length = max(3, round(BLUR_SHARE * max(picture.shape[:2])))
    return np.asarray(cv2.blur(picture, (length, 1)), np.uint8)


def halved(picture: Picture, limbs: Limbs, passed: float) -> Picture:
    """Half the width and height."""
    half = (picture.shape[1] // 2, picture.shape[0] // 2)
    return np.asarray(cv2.resize(picture, half, interpolation=cv2.INTER_AREA), np.uint8)


def second_person(picture: Picture, limbs: Limbs, passed: float) -> Picture:
    """The performer's box, mirrored, pasted beside: on the side with more room."""
    height, width = picture.shape[:2]
    corners = np.array(box_about(limbs, MARGIN * np.ptp(limbs[:, 1])))
    (x0, y0), (x1, y1) = np.clip(corners, 0, (width, height))
    patch = picture[y0:y1, x0:x1][:, ::-1]
    by = round(PASTED_BESIDE * (x1 - x0)) * (1 if x0 + x1 < width else -1)
    first, last = max(x0 + by, 0), min(x1 + by, width)
    pasted = picture.copy()
    pasted[y0:y1, first:last] = patch[:, first - x0 - by : last - x0 - by]
    return pasted


def box_about(points: Float[np.ndarray, "N 2"], margin: float) -> list[tuple[int, int]]:
    """Upper left and lower right corner of points with a margin, whole pixels."""
    corners = (points.min(axis=0) - margin, points.max(axis=0) + margin)
    return [(round(float(x)), round(float(y))) for x, y in corners]


PLAIN = Degradation("plain", "as filmed")
DEGRADATIONS = (
    PLAIN,
    Degradation("legs", "legs hidden", hidden_legs),
    Degradation("blur", "blur", motion_blur),
    Degradation("half", "half the resolution", halved, scale=0.5),
    Degradation("second", "second person", second_person),
    Degradation("dropped", "frames dropped", dropped=DROPPED),
)


# The performer's limb joints in the pictures, from a calibrated triangulation.

SIDES, PARTS = ("left", "right"), ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
LIMBS = [f"{side}_{part}" for side in SIDES for part in PARTS]
SHIFTS = range(-3, 4)  # frames by which reference and pictures may differ


def reference_limbs(folder: Path, video: str, frames: int) -> Float[np.ndarray, "T 12 2"]:
    """Limb joints (`LIMBS`) in the first frames of a video, pixels; NaN where there are none."""
    truth = read_pose2sim_truth(folder, {video: np.arange(frames)}).videos[video]
    assert truth.joints is not None
    assert truth.K is not None
    assert truth.R is not None
    assert truth.t is not None
    columns = [truth.joint_names.index(name) for name in LIMBS]
    in_camera = truth.joints[:, columns] @ truth.R.T + truth.t
    pixels = in_camera @ truth.K.T
    return np.asarray(pixels[..., :2] / pixels[..., 2:])


def shifted(limbs: Float[np.ndarray, "T 12 2"], by: int) -> Float[np.ndarray, "T 12 2"]:
    """The same so many frames later; NaN where there are none."""
    moved = np.full_like(limbs, np.nan)
    if by >= 0:
        moved[: len(limbs) - by] = limbs[by:]
    else:
        moved[-by:] = limbs[:by]
    return moved


# The default detector on degraded footage, against a calibrated triangulation.

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


NAME = "detector"
ACTIONS = ("balance_beam", "crowd")
FRAMES, FRAMES_SMALL = 100, 40  # of each video
HEAD = (
    *("action", "footage", "performer followed %", "error, % of the height"),
    *("PCK .2", "PCK .1", "swapped bodies", "ms a frame"),
)


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The table as Markdown, and what was written."""
    names = [d.name for d in DEGRADATIONS]
    unknown = [name for name in options.only if name not in ACTIONS]
    unknown += [name for name in options.variants if name not in names]
    if unknown:
        expected = ", ".join((*ACTIONS, *names))
        raise WrongUse(f"{unknown[0]}: expected an action or a degradation, of {expected}")
    scores: list[DetectorScore] = []
    for action in ACTIONS:
        if options.only and action not in options.only:
            continue
        folder = data_folder(workspace.root, action)
        if not (folder / "videos").is_dir():
            raise WorkFailed(f"{folder}: expected a folder of videos; IMOCAP_DATA names the data")
        frames = FRAMES_SMALL if options.small else FRAMES
        scores += measure(action, folder, frames, options.variants, display)
    text = markdown(scores)
    folder = workspace.root / "artifacts" / "benchmark" / NAME
    write_texts(folder, {"table.md": text})
    return [text, f"Written to {folder}"]


def markdown(scores: Sequence[DetectorScore]) -> str:
    """The whole report."""
    rows = [
        [
            score.action,
            score.footage,
            *(cell(v, 1) for v in (score.followed_pct, score.error_pct, score.pck_2, score.pck_1)),
            str(score.swapped),
            cell(score.ms, 0),
        ]
        for score in scores
    ]
    return (
        "# The detector on degraded footage\n\nMade by `imocap benchmark detector`. The reference "
        "is a calibrated triangulation of other detections; the performer is the person with the "
        "largest presence, size and motion, and followed where the mean error is below 10 % of "
        "the height. Missing joints count as wrong in PCK. Milliseconds are of the worker, without "
        "decoding.\n\n" + markdown_table(HEAD, rows) + "\n"
    )

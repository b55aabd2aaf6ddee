"""Harmless perturbations of an action: of its keypoints, its pictures, and its declaration.

Each keeps everything that a person would call the action: a result that it moves was not settled.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import copyfile
from typing import Any

import cv2
import numpy as np
import yaml
from jaxtyping import Float, UInt8

from benchmarks.actions.action_folder import action_key, make_whole
from benchmarks.actions.captured_videos import SEED
from benchmarks.actions.prepare import copy_file, detected_declaration, source_files
from imocap_core.io.video import probe, read_rgb, write_h264
from imocap_core.pipeline.action import DETECT, FILE_NAME
from imocap_core.pipeline.source import closure
from imocap_core.pipeline.yaml_file import load_yaml

SHIFT_PX = 1.0
NOISE_SHARE = 0.01  # of the person's size in the picture
SCALE = 1.005
JPEG_QUALITY = 90

Points = Float[np.ndarray, "*people K 3"]  # x, y (pixels), confidence; confidence 0: missing
Picture = UInt8[np.ndarray, "height width 3"]
Declared = dict[str, Any]  # a video of action.yaml


@dataclass(frozen=True)
class Perturbation:
    """One change of an action; what is None stays as it is.

    points: of each frame's keypoints (points, the person's size in pixels, generator). picture: of
    each frame's picture. frames: of each video's range of frames (first, one past the last).
    """

    name: str
    title: str
    points: Callable[[Points, float, np.random.Generator], Points] | None = None
    picture: Callable[[Picture, np.random.Generator], Picture] | None = None
    frames: Callable[[int, int], tuple[int, int]] | None = None
    is_reversed: bool = False
    is_scaled: bool = False
    has_other_threads: bool = False


def shifted_points(points: Points, size_px: float, rng: np.random.Generator) -> Points:
    """All keypoints one pixel to the right and down."""
    return _moved(points, np.full((*points.shape[:-1], 2), SHIFT_PX))


def noisy_points(points: Points, size_px: float, rng: np.random.Generator) -> Points:
    """Independent normal noise of 1 % of the person's size on every coordinate."""
    return _moved(points, NOISE_SHARE * size_px * rng.normal(size=(*points.shape[:-1], 2)))


def scaled_points(points: Points, scale_xy: tuple[float, float]) -> Points:
    """Keypoints in a picture that is larger by a factor along each axis."""
    return np.concatenate([points[..., :2] * scale_xy, points[..., 2:]], axis=-1)


def person_size_px(people: Sequence[Points]) -> float:
    """Longer side of the box of the largest person of a frame; NaN where nobody is detected."""
    boxes = []
    for person in people:
        xy = person[person[:, 2] > 0, :2]
        if len(xy):
            boxes.append(float(np.ptp(xy, axis=0).max()))
    return max(boxes, default=float("nan"))


def recompressed_picture(picture: Picture, rng: np.random.Generator) -> Picture:
    """The picture after JPEG compression of quality 90."""
    bgr = np.ascontiguousarray(picture[..., ::-1])
    _, coded = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    decoded = np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR), np.uint8)
    return decoded[..., ::-1]


def grey_level_picture(picture: Picture, rng: np.random.Generator) -> Picture:
    """One grey level more or less in every pixel, at random: what decoders differ by."""
    step = rng.choice(np.array([-1, 1], np.int16), size=(*picture.shape[:2], 1))
    return np.clip(picture + step, 0, 255).astype(np.uint8)


def shifted_picture(picture: Picture, rng: np.random.Generator) -> Picture:
    """The picture one pixel to the right and down, its first row and column repeated."""
    return np.pad(picture, ((1, 0), (1, 0), (0, 0)), mode="edge")[:-1, :-1]


def without_first(first: int, stop: int) -> tuple[int, int]:
    """A range of frames without its first."""
    return first + 1, stop


def without_last(first: int, stop: int) -> tuple[int, int]:
    """A range of frames without its last."""
    return first, stop - 1


def scaled_size(size: tuple[int, int], even: bool) -> tuple[int, int]:
    """A picture's size half a percent larger, to the next even number where H.264 needs one."""
    step = 2 if even else 1
    width, height = (step * round(SCALE * side / step) for side in size)
    return width, height


def _moved(points: Points, by_px: Float[np.ndarray, "*people K 2"]) -> Points:
    """Detected keypoints moved; missing ones stay."""
    detected = points[..., 2:] > 0
    return np.concatenate([points[..., :2] + detected * by_px, points[..., 2:]], axis=-1)


UNDISTURBED = Perturbation("undisturbed", "undisturbed")
DECLARATIONS = (
    Perturbation("first_frame", "one frame less at the beginning", frames=without_first),
    Perturbation("last_frame", "one frame less at the end", frames=without_last),
    Perturbation("order", "order of the videos reversed", is_reversed=True),
    Perturbation("scale", "half a percent larger", is_scaled=True),
    Perturbation("threads", "another number of threads", has_other_threads=True),
)
OF_FILES = (
    UNDISTURBED,
    Perturbation("shift", "keypoints shifted by one pixel", points=shifted_points),
    Perturbation("noise", "1 % noise on the keypoints", points=noisy_points),
    *DECLARATIONS,
)
OF_PIXELS = (
    UNDISTURBED,
    Perturbation("jpeg", "JPEG of quality 90", picture=recompressed_picture),
    Perturbation("grey", "one grey level, as of another decoder", picture=grey_level_picture),
    Perturbation("shift", "pictures shifted by one pixel", picture=shifted_picture),
    *DECLARATIONS,
)


# Perturbed copies of an action as action folders of their own: all that the stages read.
#
# A folder appears complete or not at all, and is made again when its code or the action has
# changed.

CRF = 6  # H.264 quality of changed pictures: what is coded again differs by less than the change
TRUTHS = "*.npz"  # beside action.yaml: the truth, or a calibrated rig's files
POINTS = "pose_keypoints_2d"
Scale = tuple[float, float]


def variant_key(source: Path, perturbation: Perturbation, detected: bool) -> str:
    """Digest of all that a variant is made of."""
    recipe = [closure(Path(__file__)), perturbation.name, detected]
    return action_key(recipe, source_files(source))


def make_variant(folder: Path, source: Path, perturbation: Perturbation, detected: bool) -> None:
    """Write the perturbed action into `folder` unless it was made already.

    detected: keypoints are to be detected in the pictures, whatever the action declares.
    """
    key = variant_key(source, perturbation, detected)
    make_whole(folder, key, lambda new: _write(new, folder.name, source, perturbation, detected))


def _write(
    folder: Path, name: str, source: Path, perturbation: Perturbation, detected: bool
) -> None:
    action = load_yaml(source / FILE_NAME)
    videos = []
    for number, declared in enumerate(action["videos"]):
        rng = np.random.default_rng([SEED, number])
        videos.append(_video(folder, source, declared, perturbation, detected, rng))
    action |= {"name": name, "videos": videos[::-1] if perturbation.is_reversed else videos}
    for file in source.glob(TRUTHS):
        copyfile(file, folder / file.name)
    (folder / FILE_NAME).write_text(yaml.safe_dump(action, sort_keys=False))


def _video(
    folder: Path,
    source: Path,
    declared: Declared,
    perturbation: Perturbation,
    detected: bool,
    rng: np.random.Generator,
) -> Declared:
    """Write one video's files; its declaration in the variant."""
    new = detected_declaration(declared) if detected else dict(declared)
    if perturbation.frames is not None:
        new["frames"] = list(perturbation.frames(*frame_range(source, declared)))
    if declared.get("initial") not in (None, DETECT):
        copy_file(source, folder, declared["initial"])
    scale = _write_pictures(folder, source, declared, perturbation, rng)
    if "size" in declared and perturbation.is_scaled:
        new["size"] = list(scaled_size(declared["size"], "video" in declared))
        scale = _ratio(declared["size"], new["size"])
    if new["keypoints"] != DETECT:
        _write_points(folder, source, declared["keypoints"], perturbation, scale, rng)
    return new


def frame_range(source: Path, declared: Declared) -> tuple[int, int]:
    """First used frame of a video and one past its last."""
    if declared.get("frames") is not None:
        first, stop = declared["frames"]
        return first, stop
    if "video" in declared:
        return 0, probe(source / declared["video"]).frame_count
    return 0, len(list((source / declared["keypoints"]).glob("*.json")))


def _write_pictures(
    folder: Path,
    source: Path,
    declared: Declared,
    perturbation: Perturbation,
    rng: np.random.Generator,
) -> Scale:
    """Write the video, where there is one; by how much its pictures are larger along each axis."""
    if "video" not in declared:
        return 1.0, 1.0
    file = source / declared["video"]
    if perturbation.picture is None and not perturbation.is_scaled:
        copy_file(source, folder, declared["video"])
        return 1.0, 1.0
    info = probe(file)
    size = scaled_size(info.size, True) if perturbation.is_scaled else info.size
    (folder / declared["video"]).parent.mkdir(parents=True, exist_ok=True)
    pictures = _pictures(file, size, perturbation, rng)
    write_h264(folder / declared["video"], pictures, info.fps, crf=CRF)
    return _ratio(info.size, size)


def _pictures(
    file: Path, size: tuple[int, int], perturbation: Perturbation, rng: np.random.Generator
) -> Iterator[Picture]:
    for _, picture in read_rgb(file):
        if perturbation.is_scaled:
            yield np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_CUBIC), np.uint8)
        else:
            assert perturbation.picture is not None
            yield perturbation.picture(picture, rng)


def _write_points(
    folder: Path,
    source: Path,
    keypoints: str,
    perturbation: Perturbation,
    scale: Scale,
    rng: np.random.Generator,
) -> None:
    """Write OpenPose's files of a video, every person of every frame perturbed."""
    files = sorted((source / keypoints).glob("*.json"))
    if perturbation.points is None and scale == (1.0, 1.0):
        for file in files:
            copy_file(source, folder, str(file.relative_to(source)))
        return
    frames = [json.loads(file.read_text()) for file in files]
    sizes = [person_size_px([_points(p) for p in frame["people"]]) for frame in frames]
    size_px = float(np.nanmedian(sizes))
    (folder / keypoints).mkdir(parents=True)
    for file, frame in zip(files, frames, strict=True):
        for person in frame["people"]:
            points = _points(person)
            if perturbation.points is not None:
                points = perturbation.points(points, size_px, rng)
            person[POINTS] = scaled_points(points, scale).ravel().tolist()
        (folder / keypoints / file.name).write_text(json.dumps(frame))


def _points(person: dict[str, Any]) -> Points:
    return np.array(person[POINTS], dtype=np.float64).reshape(-1, 3)


def _ratio(before: tuple[int, int], after: tuple[int, int]) -> Scale:
    return after[0] / before[0], after[1] / before[1]

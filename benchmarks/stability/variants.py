"""Perturbed copies of an action as action folders of their own: all that the stages read.

A folder appears complete or not at all, and is made again when its code or the action has changed.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from shutil import copyfile
from typing import Any

import cv2
import numpy as np
import yaml

from benchmarks.actions.action_folder import action_key, make_whole
from benchmarks.actions.captured import SEED
from benchmarks.actions.real import copy_file, detected_declaration, source_files
from benchmarks.stability.perturbations import (
    Declared,
    Perturbation,
    Picture,
    Points,
    person_size_px,
    scaled_points,
    scaled_size,
)
from imocap_core.io.video import probe, read_rgb, write_h264
from imocap_core.pipeline.action import DETECT, FILE_NAME
from imocap_core.pipeline.source import closure
from imocap_core.pipeline.yaml_file import load_yaml

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

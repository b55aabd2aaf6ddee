"""A long film looked through: its shots, and everybody detected in it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from imocap_core.artifacts.store import Store
from imocap_core.collect.shots import Shot, find_shots
from imocap_core.collect.tracks import FilmPeople
from imocap_core.detect.detection import detect_video, detections_file
from imocap_core.detect.detectors import Detector
from imocap_core.detect.setup import set_up
from imocap_core.io.detectors.by_name import read_detections
from imocap_core.io.video import VideoInfo, probe, read_gray
from imocap_core.pipeline.runner import Display

COMPARED_PX = 160  # larger side of the pictures in which shots are looked for


@dataclass(frozen=True)
class LongFilm:
    """A film's file, shots and people."""

    path: Path
    info: VideoInfo
    shots: list[Shot]
    people: FilmPeople


def look_through(path: Path, detector: Detector, store: Store, display: Display) -> LongFilm:
    """Find a film's shots and detect its people, once: detections stay in the cache, where a run
    of the collected action finds them.

    ValueError or WorkFailed when it cannot be decoded, or the detector fails.
    """
    info = probe(path)
    scale = min(1.0, COMPARED_PX / max(info.size))
    display.progress(0.0, f"{path.name}: looking for shots")
    shots = find_shots(_counted(read_gray(path, scale=scale), info.frame_count, path.name, display))
    file = detections_file(store, path, detector)
    if not file.is_file():
        python = set_up(detector, lambda what: display.progress(0.0, what))
        detect_video(path, file, detector, python, display.progress)
    detections = read_detections(
        file, detector.format, detector.layout, size=info.size, names=(path.name, path.stem)
    )
    people_of = dict(zip(detections.frames.tolist(), detections.people, strict=True))
    nobody = np.zeros((0, *detections.people[0].shape[1:]))
    everybody = [people_of.get(frame, nobody) for frame in range(info.frame_count)]
    return LongFilm(path, info, shots, FilmPeople(everybody, info.size, info.fps, detector.layout))


def _counted(
    pictures: Iterator[tuple[int, UInt8[np.ndarray, "H W"]]],
    count: int,
    name: str,
    display: Display,
) -> Iterator[UInt8[np.ndarray, "H W"]]:
    for number, picture in pictures:
        if number % 100 == 0:
            display.progress(min(number / max(count, 1), 1.0), f"{name}: looking for shots")
        yield picture


def pictures_of(path: Path, frames: Iterable[int]) -> dict[int, UInt8[np.ndarray, "H W"]]:
    """Some frames of a film, grey."""
    wanted = set(frames)
    if not wanted:
        return {}
    return {
        number: picture
        for number, picture in read_gray(path, min(wanted), max(wanted) + 1)
        if number in wanted
    }

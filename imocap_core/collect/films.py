"""A long film looked through: its shots, and everybody detected and followed in it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, UInt8

from imocap_core.artifacts.store import Store
from imocap_core.collect.shots import Shot, find_shots
from imocap_core.detect.detection import detect_video, detections_file, set_up
from imocap_core.detect.detectors import Detector
from imocap_core.io.readers.keypoint_readers import read_detections
from imocap_core.io.video import VideoInfo, probe, read_gray
from imocap_core.lifter.infer import lift
from imocap_core.lifter.lifter_network import load_lifter, to_common
from imocap_core.params import KeypointsParams
from imocap_core.people.performer import ranked_tracks
from imocap_core.people.tracking import PersonTrack, box_of
from imocap_core.pipeline.runner import Display

LEAST_S = 0.3  # shorter tracks show no movement
LEAST_RANK = 0.05  # of the best score of the shot: people with less are far away, or false


@dataclass(frozen=True)
class ShotTrack:
    """One person in one shot of a film, in T frames without gaps.

    film, shot: indices. track: rank in the shot, from 0. first: frame of the film. joints: metres,
    camera axes, about the pelvis; sigma_m: their predicted errors. visible: whether the frame shows
    the person. box_px: NaN where it does not.
    """

    film: int
    shot: int
    track: int
    first: int
    fps: float
    joints: Float[np.ndarray, "T 24 3"]
    sigma_m: Float[np.ndarray, "T 24"]
    visible: Bool[np.ndarray, " T"]
    xy_px: Float[np.ndarray, "T K 2"]
    confidence: Float[np.ndarray, "T K"]
    box_px: Float[np.ndarray, "T 4"]

    @property
    def stop(self) -> int:
        """One past its last frame of the film."""
        return self.first + len(self.joints)


@dataclass(frozen=True)
class LongFilm:
    """A film's file and shots, and everybody detected in every frame (K points of `layout`: x, y,
    confidence)."""

    path: Path
    info: VideoInfo
    shots: list[Shot]
    people: Sequence[Float[np.ndarray, "_ K 3"]]
    layout: str


def shot_tracks(
    number: int, film: LongFilm, shots: Sequence[Shot], params: KeypointsParams
) -> list[ShotTrack]:
    """The people of a film's shots, the most prominent of each shot first; number: the film's."""
    tracks = []
    for n, shot in enumerate(shots):
        if shot.still:
            continue
        ranked = ranked_tracks(
            film.people[shot.first : shot.stop],
            film.info.size,
            film.info.fps,
            min_confidence=params.min_confidence,
            max_gap_s=params.max_gap_s,
        )
        for rank, (score, track) in enumerate(ranked):
            if score < LEAST_RANK * ranked[0][0] or len(track.frames) < LEAST_S * film.info.fps:
                continue
            tracks.append(_lifted(number, n, rank, shot.first, track, film))
    return tracks


def _lifted(
    number: int, shot: int, rank: int, first: int, track: PersonTrack, film: LongFilm
) -> ShotTrack:
    begin = track.frames[0]
    rows = np.array(track.frames) - begin
    poses = np.full((rows[-1] + 1, *track.poses[0].shape), np.nan)
    poses[rows] = np.stack(track.poses)
    xy, confidence = poses[..., :2], np.nan_to_num(poses[..., 2])
    box = np.full((len(poses), 4), np.nan)
    box[rows] = [box_of(pose) for pose in track.poses]
    size, fps = film.info.size, film.info.fps
    rays = (xy - 0.5 * np.array(size)) / float(max(size))
    points, trust = to_common(rays, confidence, film.layout)
    lifted = lift(load_lifter(), points, trust, fps)
    return ShotTrack(
        number,
        shot,
        rank,
        first + begin,
        fps,
        lifted.joints,
        lifted.sigma_m,
        lifted.visible,
        xy,
        confidence,
        box,
    )


COMPARED_PX = 160  # larger side of the pictures in which shots are looked for


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
    return LongFilm(path, info, shots, everybody, detector.layout)


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

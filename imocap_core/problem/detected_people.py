"""Everybody detected in the used frames of a declared video, before tracking."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int64

from imocap_core.frame_times import is_constant_rate, typical_step_s
from imocap_core.io.detectors.by_name import format_and_layout, read_detections
from imocap_core.io.detectors.people import DetectedPeople
from imocap_core.io.time_stamps import variable_times_s
from imocap_core.io.video import VideoInfo, probe
from imocap_core.limits import LEAST_FRAMES, MAX_FRAMES
from imocap_core.pipeline.action import Declaration
from imocap_core.problem.declarations import at_declared_rate, check_declared
from imocap_core.problem.keypoint_reading import Reading, reading_of, reading_without_video
from imocap_core.problem.tracked_people import TrackedVideo
from imocap_core.problem.video_survey import VideoSurvey

AS_THEY_ARE = Reading()
IN_SHARES = ("mediapipe",)  # formats whose points come in shares of the shown picture


@dataclass(frozen=True)
class DetectedVideo:
    """One video's declaration, files and people: `kind` is the format of the detections.

    survey: of the pictures, where there is a video and they have been looked through. time_s: when
    the used frames were taken, where the frame rate is variable. reading: of the keypoints' pixels
    and numbers. remarks: how the file and its keypoints were read, where it is not as usual.
    """

    declared: Declaration
    folder: Path
    video: Path | None
    kind: str
    people: TrackedVideo  # without tracks until `track_people`
    survey: VideoSurvey | None = None
    time_s: Float[np.ndarray, " T"] | None = None
    reading: Reading = AS_THEY_ARE
    remarks: tuple[str, ...] = ()
    mirrored: bool = False  # the file has its players show the mirror image

    @property
    def id(self) -> str:
        """The video's id."""
        return self.declared.id


def read_people(
    declared: Declaration, folder: Path, video: Path | None, file: Path
) -> DetectedVideo:
    """Read a video's detections in its used frames; `file`: the action.yaml, for messages."""
    probed = None if video is None else probe(video)
    check_declared(declared, probed, file)
    if probed is not None:
        probed = at_declared_rate(declared, probed)
    kind, layout = format_and_layout(folder, declared.format, declared.layout)
    size = declared.size if probed is None else probed.size
    assert size is not None
    names = (declared.id, *((video.name, video.stem) if video is not None else ()))
    detections = read_detections(folder, kind, layout, size=size, names=names)
    info = probed or _declared_info(declared, detections)
    reading = AS_THEY_ARE
    if probed is not None and video is not None and not declared.detected:
        placed = kind in IN_SHARES
        reading = reading_of(detections, probed, video, folder, used=declared.frames, placed=placed)
    elif probed is None:
        reading = reading_without_video(detections, size)
    detections = reading.read(detections, info.frame_count, layout)
    frames = _used_frames(declared, info.frame_count, file)
    time_s = None if video is None else _uneven_times_s(video, info, frames)
    people_of = dict(zip(detections.frames.tolist(), detections.people, strict=True))
    nobody = np.zeros((0, *detections.people[0].shape[1:]))
    people = TrackedVideo(
        id=declared.id,
        people=[people_of.get(int(frame), nobody) for frame in frames],
        frames=frames,
        size=info.size,
        fps=info.fps if time_s is None else 1 / typical_step_s(time_s),
        layout=layout,
        focal_px=declared.focal_px or float(max(info.size)),
        ranked=[],
        person=declared.person,
    )
    return DetectedVideo(
        declared,
        folder,
        video,
        kind,
        people,
        time_s=time_s,
        reading=reading,
        remarks=(*_remarks(info), *reading.words),
        mirrored=info.display is not None and info.display.mirrored,
    )


def _remarks(info: VideoInfo) -> Iterator[str]:
    """What is unusual in how a file is shown."""
    if info.slowed != 1.0:
        slower = info.slowed > 1
        times = f"{max(info.slowed, 1 / info.slowed):.3g} times {'slower' if slower else 'faster'}"
        yield f"the time stamps play it {times} than it was taken: read at {info.fps:.4g} frames/s"
    if info.display is not None and info.display.aspect != 1.0:
        stored, shown = ("{} x {}".format(*size) for size in (info.display.stored, info.size))
        yield f"the pixels of the file ({stored}) are not square: read as {shown}"
    if info.display is not None and info.display.mirrored:
        yield "the picture is shown in a mirror, as the file says"


def _uneven_times_s(
    video: Path, info: VideoInfo, frames: Int64[np.ndarray, " T"]
) -> Float[np.ndarray, " T"] | None:
    """Presentation times of the used frames; None where these have the constant rate `info.fps`."""
    times = variable_times_s(video, info)
    if times is None or is_constant_rate(times[frames], info.fps):
        return None
    return times[frames]


def _declared_info(declared: Declaration, detections: DetectedPeople) -> VideoInfo:
    """Frame rate and size as action.yaml declares them, for keypoints without a video file."""
    assert declared.fps is not None
    assert declared.size is not None
    return VideoInfo(declared.fps, declared.size, int(detections.frames[-1]) + 1)


def _used_frames(declared: Declaration, count: int, file: Path) -> Int64[np.ndarray, " T"]:
    """Source frame numbers."""
    first, stop = declared.frames or (0, count)
    if stop > count:
        raise ValueError(
            f"{file}: videos.{declared.id}.frames: expected at most [0, {count}], as the clip has "
            f"{count} frames, got [{first}, {stop}]"
        )
    if stop - first < LEAST_FRAMES:
        raise ValueError(
            f"{file}: videos.{declared.id}.frames: expected at least {LEAST_FRAMES} frames, as "
            f"fewer have no motion, got {stop - first}; remove {declared.id}, or use more of it"
        )
    if stop - first > MAX_FRAMES:
        raise ValueError(
            f"{file}: videos.{declared.id}.frames: expected at most {MAX_FRAMES:,} frames, got "
            f"{stop - first:,}; if the detections are numbered by milliseconds, number them by "
            f"frames; of a long clip, use a part: frames: [first, one past last]"
        )
    return np.arange(first, stop, dtype=np.int64)

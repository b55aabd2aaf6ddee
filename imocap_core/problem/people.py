"""Everybody whom the detector found in a declared video, before anybody is followed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from imocap_core.io.detectors.by_name import format_and_layout, read_detections
from imocap_core.io.detectors.people import DetectedPeople
from imocap_core.io.video import VideoInfo, probe
from imocap_core.pipeline.action import Declaration
from imocap_core.problem.performers import Watched


@dataclass(frozen=True)
class Source:
    """Where one video's people come from: `kind` is the detections' format."""

    declared: Declaration
    folder: Path
    video: Path | None
    kind: str
    watched: Watched  # nobody followed yet


def people_in(declared: Declaration, folder: Path, video: Path | None, file: Path) -> Source:
    """Read a video's detections in its used frames; `file`: the action.yaml, for messages."""
    probed = None if video is None else probe(video)
    kind, layout = format_and_layout(folder, declared.format, declared.layout)
    size = declared.size if probed is None else probed.size
    assert size is not None
    names = (declared.id, *((video.name, video.stem) if video is not None else ()))
    found = read_detections(folder, kind, layout, size=size, names=names)
    info = probed or _declared_info(declared, found)
    frames = _used_frames(declared, info.frame_count, file)
    people_of = dict(zip(found.frames.tolist(), found.people, strict=True))
    nobody = np.zeros((0, *found.people[0].shape[1:]))
    watched = Watched(
        id=declared.id,
        people=[people_of.get(int(frame), nobody) for frame in frames],
        frames=frames,
        size=info.size,
        fps=info.fps,
        layout=layout,
        focal_px=declared.focal_px or float(max(info.size)),
        ranked=[],
        person=declared.person,
    )
    return Source(declared, folder, video, kind, watched)


def _declared_info(declared: Declaration, found: DetectedPeople) -> VideoInfo:
    """As action.yaml declares a video that is not there."""
    assert declared.fps is not None
    assert declared.size is not None
    return VideoInfo(declared.fps, declared.size, int(found.frames[-1]) + 1)


def _used_frames(declared: Declaration, count: int, file: Path) -> np.ndarray:
    """Source frame numbers (T,)."""
    first, stop = declared.frames or (0, count)
    if stop > count:
        raise ValueError(
            f"{file}: videos.{declared.id}.frames: expected at most [0, {count}], as the clip has "
            f"{count} frames, got [{first}, {stop}]"
        )
    return np.arange(first, stop, dtype=np.int64)

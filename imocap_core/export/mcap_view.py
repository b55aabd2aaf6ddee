"""The view file: every video's body, camera, frames and keypoints on one clock."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from imocap_core.body.kinematics import world_rotations
from imocap_core.camera.zooming import lens_of
from imocap_core.errors import WorkFailed
from imocap_core.export.clips import camera_of, shaped_of, take_of
from imocap_core.export.notes import notes_of
from imocap_core.export.values import Performance, Result
from imocap_core.io.video import read_rgb
from imocap_core.io.writers import foxglove
from imocap_core.io.writers.mcap_view import Entry, entry, write_view

Array = NDArray[np.float64]

LONGER_PX = 480  # side of the pictures
JPEG_QUALITY = 75
SECOND = foxglove.SECOND


def write_mcap(out: Path, result: Result) -> list[Path]:
    """Write <action>.mcap and return its path; without pictures where there is no video."""
    from imocap_core.figures.style import VIDEO_COLORS

    entries: list[Entry] = []
    orders = {}
    for k, p in enumerate(result.performances):
        code = VIDEO_COLORS[k % len(VIDEO_COLORS)]
        red, green, blue = (int(code[i : i + 2], 16) / 255 for i in (1, 3, 5))
        take = take_of(p, shaped_of(result, p))
        orders[p.id] = list(take.joint_names)
        entries += _body(result, p, (red, green, blue))
        entries += _camera(result, p, (red, green, blue))
    file = out / f"{result.action}.mcap"
    notes = notes_of(result, "mcap") | {"joints": orders}
    write_view(file, entries, {name: json.dumps(value) for name, value in notes.items()})
    return [file]


def times_ns(p: Performance) -> list[int]:
    """(T,) the clock of a performance's frames; it starts at 0."""
    return [round(t * SECOND / p.fps) for t in range(len(p.frames))]


def _body(result: Result, p: Performance, colour: foxglove.Colour) -> Iterator[Entry]:
    take = take_of(p, shaped_of(result, p))
    R = world_rotations(torch.as_tensor(take.R_local), take.parents).numpy()
    for t, time in enumerate(times_ns(p)):
        places = take.joints[t]
        yield entry(time, f"/{p.id}/joints", foxglove.joints(time, places, R[t]))
        bones = foxglove.skeleton(time, p.id, places, take.parents, colour)
        yield entry(time, f"/{p.id}/skeleton", bones)


def _camera(result: Result, p: Performance, colour: foxglove.Colour) -> Iterator[Entry]:
    """Where it is, its lens, its pictures and the keypoints in them, every frame."""
    camera = camera_of(p)
    scale = min(1.0, LONGER_PX / max(p.seen.size))
    size = (round(scale * p.seen.size[0]), round(scale * p.seen.size[1]))
    smaller = np.diag([size[0] / p.seen.size[0], size[1] / p.seen.size[1], 1.0])
    K = smaller @ lens_of(p.K, p.zoom)
    pictures = dict(_pictures(result, p, size))
    for t, time in enumerate(times_ns(p)):
        R = camera.R_cam_from_world[t if len(camera.R_cam_from_world) > 1 else 0]
        at = f"/{p.id}/camera"
        where = foxglove.transform(time, p.id, R, camera.centre)
        yield entry(time, f"{at}/transform", where)
        yield entry(time, f"{at}/calibration", foxglove.calibration(time, p.id, K[t], size))
        if not p.inside[t]:
            continue
        row = int(np.searchsorted(p.seen.frames, _nearest(p)[t]))
        xy = np.where(p.seen.confidence[row, :, None] > 0, p.seen.xy_px[row], np.nan)
        points = foxglove.keypoints(time, xy * np.divide(size, p.seen.size), colour)
        yield entry(time, f"{at}/keypoints", points)
        if t in pictures:
            yield entry(time, f"{at}/image", foxglove.image(time, p.id, pictures[t]))


def _nearest(p: Performance) -> NDArray[np.int64]:
    """(T,) the source frame nearest to each of the performance's."""
    return np.asarray(p.seen.frames[np.abs(p.seen.frames - p.frames[:, None]).argmin(1)])


def _pictures(result: Result, p: Performance, size: tuple[int, int]) -> Iterator[tuple[int, bytes]]:
    """(t, JPEG) of the performance's frames, from the video, made smaller."""
    if p.seen.video is None or result.folder is None:
        return
    file = result.folder / p.seen.video
    if not file.is_file():
        raise WorkFailed(
            f"{file}: there is no such video, whose frames {result.action}'s view file would show; "
            f"put it back, or take the video's name out of action.yaml"
        )
    wanted: dict[int, list[int]] = {}
    for t, frame in enumerate(_nearest(p)):
        if p.inside[t]:
            wanted.setdefault(int(frame), []).append(t)
    for number, picture in read_rgb(file, min(wanted), max(wanted) + 1):
        if number not in wanted:
            continue
        small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
        quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        _, data = cv2.imencode(".jpg", cv2.cvtColor(small, cv2.COLOR_RGB2BGR), quality)
        for t in wanted[number]:
            yield t, data.tobytes()

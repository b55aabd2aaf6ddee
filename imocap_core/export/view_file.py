"""The view file: every video's body, camera, frames and keypoints on one clock."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import Int

from imocap_core.body.kinematics import world_rotations
from imocap_core.errors import WorkFailed
from imocap_core.export.clips import camera_of, clip_of
from imocap_core.export.side_files import notes_of
from imocap_core.io.video import read_rgb_of
from imocap_core.io.writers import foxglove
from imocap_core.io.writers.foxglove import Entry, entry, write_view
from imocap_core.io.writers.motion_clip import MotionClip
from imocap_core.result.result import ActionResult
from imocap_core.result.video import VideoResult
from imocap_core.result.video_motion import shaped_body

LONGER_PX = 480  # side of the pictures
JPEG_QUALITY = 75
SECOND = foxglove.SECOND


def write_mcap(out: Path, result: ActionResult) -> list[Path]:
    """Write <action>.mcap and return its path; without pictures where there is no video."""
    from imocap_core.figures.style import VIDEO_COLORS

    entries: list[Entry] = []
    orders = {}
    for k, video in enumerate(result):
        code = VIDEO_COLORS[k % len(VIDEO_COLORS)]
        red, green, blue = (int(code[i : i + 2], 16) / 255 for i in (1, 3, 5))
        clip = clip_of(video, shaped_body(video))
        orders[video.id] = list(clip.joint_names)
        entries += _body(clip, times_ns(video), (red, green, blue))
        entries += _camera(result, video, (red, green, blue))
    file = out / f"{result.action}.mcap"
    notes = notes_of(result, "mcap") | {"joints": orders}
    write_view(file, entries, {name: json.dumps(value) for name, value in notes.items()})
    return [file]


def times_ns(video: VideoResult) -> list[int]:
    """(T,) the clock of a video's frames, nanoseconds; it starts at 0."""
    return [round(t * SECOND / video.fps) for t in range(len(video.frames))]


def _body(clip: MotionClip, times: list[int], colour: foxglove.Colour) -> Iterator[Entry]:
    """Joints with their axes, and the bones as lines, every frame."""
    R = world_rotations(torch.as_tensor(clip.R_local), clip.parents).numpy()
    for t, time in enumerate(times):
        places = clip.joints[t]
        yield entry(time, f"/{clip.id}/joints", foxglove.joints(time, places, R[t]))
        bones = foxglove.skeleton(time, clip.id, places, clip.parents, colour)
        yield entry(time, f"/{clip.id}/skeleton", bones)


def _camera(result: ActionResult, video: VideoResult, colour: foxglove.Colour) -> Iterator[Entry]:
    """The camera's pose, its intrinsics, its pictures and the keypoints in them, every frame."""
    camera, detected = camera_of(video), video.keypoints
    scale = min(1.0, LONGER_PX / max(camera.size))
    size = (round(scale * camera.size[0]), round(scale * camera.size[1]))
    smaller = np.diag([size[0] / camera.size[0], size[1] / camera.size[1], 1.0])
    K = smaller @ video.camera.K_per_frame
    lens = [video.camera.distortion_at(K_t) for K_t in video.camera.K_per_frame]
    nearest = _nearest(video)
    pictures = dict(_pictures(result, video, nearest, size))
    for t, time in enumerate(times_ns(video)):
        R = camera.R_cam_from_world[t if len(camera.R_cam_from_world) > 1 else 0]
        topic = f"/{video.id}/camera"
        place = camera.centre[t if len(camera.centre) > 1 else 0]
        where = foxglove.transform(time, video.id, R, place)
        yield entry(time, f"{topic}/transform", where)
        intrinsics = foxglove.calibration(time, video.id, K[t], size, lens[t])
        yield entry(time, f"{topic}/calibration", intrinsics)
        if not video.inside[t]:
            continue
        row = int(np.searchsorted(detected.frames, nearest[t]))
        xy = np.where(detected.confidence[row, :, None] > 0, detected.xy_px[row], np.nan)
        points = foxglove.keypoints(time, xy * np.divide(size, camera.size), colour)
        yield entry(time, f"{topic}/keypoints", points)
        if t in pictures:
            yield entry(time, f"{topic}/image", foxglove.image(time, video.id, pictures[t]))


def _nearest(video: VideoResult) -> Int[np.ndarray, " T"]:
    """(T,) the used source frame nearest to each of the video's frames."""
    used = video.keypoints.frames
    return np.asarray(used[np.abs(used - video.frames[:, None]).argmin(1)])


def _pictures(
    result: ActionResult, video: VideoResult, nearest: Int[np.ndarray, " T"], size: tuple[int, int]
) -> Iterator[tuple[int, bytes]]:
    """(t, JPEG) of the video's frames, made smaller."""
    if video.keypoints.video is None or result.folder is None:
        return
    if video.video is None:
        raise WorkFailed(
            f"{result.folder / video.keypoints.video}: there is no such video, whose frames "
            f"{result.action}'s view file would show; put it back, or take the video's name out of "
            f"action.yaml"
        )
    moments: dict[int, list[int]] = {}
    for t, frame in enumerate(nearest):
        if video.inside[t]:
            moments.setdefault(int(frame), []).append(t)
    for number, picture in read_rgb_of(video.video, moments):
        small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
        quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        _, data = cv2.imencode(".jpg", cv2.cvtColor(small, cv2.COLOR_RGB2BGR), quality)
        for t in moments[number]:
            yield t, data.tobytes()

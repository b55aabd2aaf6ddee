"""Every video's body, camera, pictures and keypoints on one clock, for Foxglove and for Rerun.

A recording for Rerun opens laid out: the world of all bodies and cameras beside each video's
picture. Rerun's library is an extra of the installation, because it is larger than the rest.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from jaxtyping import Float, Int

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
    entries: list[Entry] = []
    orders = {}
    for number, video in enumerate(result):
        clip = clip_of(video, shaped_body(video))
        orders[video.id] = list(clip.joint_names)
        entries += _body(clip, _times_ns(video), _colour_of(number))
        entries += _camera(result, video, _colour_of(number))
    file = out / f"{result.action}.mcap"
    notes = notes_of(result, "mcap") | {"joints": orders}
    write_view(file, entries, {name: json.dumps(value) for name, value in notes.items()})
    return [file]


def _colour_of(number: int) -> foxglove.Colour:
    """Of a video, by its place among those of the result."""
    from matplotlib.colors import to_rgb

    from imocap_core.figures.style import VIDEO_COLORS

    return to_rgb(VIDEO_COLORS[number % len(VIDEO_COLORS)])


def _times_ns(video: VideoResult) -> list[int]:
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
    topic = f"/{video.id}/camera"
    for frame in _filmed_frames(result, video):
        time = frame.time_ns
        where = foxglove.transform(time, video.id, frame.R_cam_from_world, frame.centre)
        yield entry(time, f"{topic}/transform", where)
        intrinsics = foxglove.calibration(time, video.id, frame.K, frame.size, frame.lens)
        yield entry(time, f"{topic}/calibration", intrinsics)
        if frame.xy_px is not None:
            points = foxglove.keypoints(time, frame.xy_px, colour)
            yield entry(time, f"{topic}/keypoints", points)
        if frame.jpeg is not None:
            yield entry(time, f"{topic}/image", foxglove.image(time, video.id, frame.jpeg))


@dataclass(frozen=True)
class _FilmedFrame:
    """One frame of a video, made smaller: where its camera is and what it shows.

    Attributes:
        time_ns: on the video's clock, which starts at 0.
        R_cam_from_world: (3, 3); centre: (3,) metres; K: (3, 3) of the smaller picture.
        size: its width and height; lens: distortion coefficients.
        xy_px: (K, 2) keypoints, NaN where not detected; None: a moment beyond the video's ends.
        jpeg: the picture, or None.
    """

    time_ns: int
    R_cam_from_world: Float[np.ndarray, "3 3"]
    centre: Float[np.ndarray, "3"]
    K: Float[np.ndarray, "3 3"]
    size: tuple[int, int]
    lens: Float[np.ndarray, "5"]
    xy_px: Float[np.ndarray, "K 2"] | None
    jpeg: bytes | None


def _filmed_frames(result: ActionResult, video: VideoResult) -> Iterator[_FilmedFrame]:
    """Every frame of a video.

    Raises:
        WorkFailed: the video of which the action tells is not there.
    """
    camera, detected = camera_of(video), video.keypoints
    scale = min(1.0, LONGER_PX / max(camera.size))
    size = (round(scale * camera.size[0]), round(scale * camera.size[1]))
    smaller = np.diag([size[0] / camera.size[0], size[1] / camera.size[1], 1.0])
    used = detected.frames
    nearest = used[np.abs(used - video.frames[:, None]).argmin(1)]  # to each of the video's frames
    pictures = dict(_pictures(result, video, nearest, size))
    for t, time in enumerate(_times_ns(video)):
        K = smaller @ video.camera.K_per_frame[t]
        row = int(np.searchsorted(detected.frames, nearest[t]))
        xy = np.where(detected.confidence[row, :, None] > 0, detected.xy_px[row], np.nan)
        yield _FilmedFrame(
            time,
            camera.R_cam_from_world[t if len(camera.R_cam_from_world) > 1 else 0],
            camera.centre[t if len(camera.centre) > 1 else 0],
            K,
            size,
            video.camera.distortion_at(video.camera.K_per_frame[t]),
            xy * np.divide(size, camera.size) if video.inside[t] else None,
            pictures.get(t),
        )


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


WORLD_SHARE = 3, 2  # of the window's width, and that of the pictures
JOINT_M, BONE_M, KEYPOINT_PX = 0.02, 0.01, 3.0  # radii


def write_rrd(out: Path, result: ActionResult) -> list[Path]:
    """Write <action>.rrd and return its path; without pictures where there is no video."""
    rr: Any = _library("rerun")
    file = out / f"{result.action}.rrd"
    with rr.RecordingStream("imocap", recording_id=result.action) as recording:
        recording.save(file, default_blueprint=_layout([video.id for video in result]))
        up = rr.ViewCoordinates.RIGHT_HAND_Y_UP
        recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP if result.up_axis == "z" else up)
        for number, video in enumerate(result):
            colour = _colour_of(number)
            _log_body(rr, recording, video, colour)
            _log_camera(rr, recording, result, video, colour)
    return [file]


def _library(module: str) -> Any:
    try:
        return import_module(module)
    except ImportError:
        raise WorkFailed(
            "a Rerun recording needs the package rerun-sdk: pip install 'imocap[rerun]'"
        ) from None


def _layout(videos: list[str]) -> Any:
    """The world, and beside it the picture of each video."""
    rrb: Any = _library("rerun.blueprint")
    pictures = [rrb.Spatial2DView(origin=f"/{v}/camera", name=v) for v in videos]
    world = rrb.Spatial3DView(origin="/", name="world")
    columns = rrb.Horizontal(world, rrb.Grid(*pictures), column_shares=WORLD_SHARE)
    return rrb.Blueprint(columns, collapse_panels=True)


def _log_body(rr: Any, recording: Any, video: VideoResult, colour: tuple[float, ...]) -> None:
    """Joints and bones, every frame."""
    clip = clip_of(video, shaped_body(video))
    bones = [(parent, j) for j, parent in enumerate(clip.parents) if parent >= 0]
    for time, joints in zip(_times_ns(video), clip.joints, strict=True):
        recording.set_time("time", duration=time / SECOND)
        recording.log(f"/{video.id}/joints", rr.Points3D(joints, colors=colour, radii=JOINT_M))
        strips = rr.LineStrips3D(joints[bones], colors=colour, radii=BONE_M)
        recording.log(f"/{video.id}/bones", strips)


def _log_camera(
    rr: Any, recording: Any, result: ActionResult, video: VideoResult, colour: tuple[float, ...]
) -> None:
    """The camera's place and lens, its picture and the keypoints in it, every frame."""
    topic = f"/{video.id}/camera"
    for frame in _filmed_frames(result, video):
        recording.set_time("time", duration=frame.time_ns / SECOND)
        place = rr.Transform3D(translation=frame.centre, mat3x3=frame.R_cam_from_world.T)
        recording.log(topic, place, rr.Pinhole(image_from_camera=frame.K, resolution=frame.size))
        if frame.xy_px is not None:
            xy = frame.xy_px[np.isfinite(frame.xy_px).all(-1)]
            points = rr.Points2D(xy, colors=colour, radii=KEYPOINT_PX)
            recording.log(f"{topic}/keypoints", points)
        if frame.jpeg is not None:
            picture = rr.EncodedImage(contents=frame.jpeg, media_type="image/jpeg")
            recording.log(f"{topic}/picture", picture)

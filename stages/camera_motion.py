"""camera_motion: each camera's motion, and the keypoints warped into its first frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np

from imocap_core.adapters.camera_motion import background_of, camera_of_background, without_pictures
from imocap_core.adapters.even_moments import camera_at_used_frames, nearest_used
from imocap_core.adapters.lenses import undistorted_px
from imocap_core.artifacts.schemas import (
    CameraMotion,
    Keypoints,
    LensDistortion,
    VideoCameraMotion,
    VideoKeypoints,
)
from imocap_core.camera.background import FilmedPart, filmed_part, rescaled, track_background
from imocap_core.camera.camera_motion import CameraMotionEstimate
from imocap_core.camera.line_lens import KeptPictures, still_background
from imocap_core.camera.projection import warp
from imocap_core.cli import stage_main
from imocap_core.io.colmap import load_colmap
from imocap_core.io.video import GrayPicture, read_gray
from imocap_core.params import CameraMotionParams, Params
from imocap_core.pipeline.stage import Context, Inputs
from imocap_core.workers import cores

MOST_KEPT_BYTES = 64 * 2**20  # grey pictures of one video that are kept from one use to the next
BAR_PICTURES = 24  # bars are looked for in


def run(ctx: Context, inputs: Inputs, params: Params) -> CameraMotion:
    """Track the background of every video, several videos at a time."""
    videos = inputs.get(Keypoints).videos
    paths = [ctx.video(video.id) for video in videos]
    if params.camera_motion.structure and any(paths):
        load_colmap()
    ctx.progress(0.0, f"tracking the background of {len(videos)} videos")
    # threads suffice: decoding, optical flow and robust fitting all run outside Python's lock
    with ThreadPoolExecutor(cores()) as pool:
        motions = list(pool.map(_motion_of, videos, paths, [params.camera_motion] * len(videos)))
    return CameraMotion(videos=motions)


def _motion_of(
    video: VideoKeypoints, path: Path | None, params: CameraMotionParams
) -> VideoCameraMotion:
    if path is None:
        turning, lens = without_pictures(video, params.assumed_focal_factor)
    else:
        turning, lens = _look(video, path, params)
    pixels = undistorted_px(video.marks_px, lens, turning.K)
    return VideoCameraMotion(
        id=video.id,
        K=turning.K,
        focal_source=turning.focal_source,
        motion=turning.motion,
        note=turning.note,
        residual_px=turning.residual_px,
        H_first_from_frame=turning.H_first_from_frame,
        R_first_from_frame=turning.R_first_from_frame,
        zoom=turning.zoom,
        inliers=turning.inliers,
        xy_first_px=warp(turning.H_first_from_frame[:, None], pixels),
        lens=lens,
        **_path(turning),
    )


def _look(
    video: VideoKeypoints, path: Path, params: CameraMotionParams
) -> tuple[CameraMotionEstimate, LensDistortion | None]:
    scale = min(1.0, params.working_size_px / max(video.size))
    first, last = int(video.frames[0]), int(video.frames[-1])
    boxes = (video.person_box_px[nearest_used(video)] + 0.5) * scale - 0.5
    pictures, filmed = _small_pictures(video, path, scale)
    sampled = KeptPictures(last + 1 - first, {})
    small = track_background(
        sampled.passing(pictures()),
        boxes,
        max_features=params.max_features,
        min_inliers=params.min_inliers,
        threshold_px=params.reprojection_threshold_px,
    )
    if len(small) != last + 1 - first:
        raise ValueError(
            f"{path}: expected frames {first} to {last}, the video ends after {len(small)} of "
            "them; change `frames` in action.yaml or re-encode the video"
        )
    factor = filmed.share * params.assumed_focal_factor
    camera, lens = camera_of_background(
        video,
        [rescaled(match, scale) for match in small],
        params.reprojection_threshold_px / scale,
        lambda: background_of(pictures(), boxes, video.fps, video.size, scale, params),
        lambda: still_background(sampled, boxes),
        replace(params, assumed_focal_factor=factor),
    )
    if filmed.share < 1:
        words = f"black bars leave {filmed.share:.0%} of the picture's larger side"
        camera = replace(camera, note=f"{camera.note}; {words}")
    return camera_at_used_frames(camera, video), lens


def _small_pictures(
    video: VideoKeypoints, path: Path, scale: float
) -> tuple[Callable[[], Iterator[GrayPicture]], FilmedPart]:
    """The used frames made smaller, black around what is filmed, as often as asked for; decoded
    once where they are few."""
    first, stop = int(video.frames[0]), int(video.frames[-1]) + 1

    def decoded() -> Iterator[GrayPicture]:
        numbered = read_gray(path, first, stop, scale=scale, damaged=bool(video.damaged))
        return (picture for _, picture in numbered)

    few = (stop - first) * scale**2 * video.size[0] * video.size[1] <= MOST_KEPT_BYTES
    pictures = list(decoded()) if few else []
    step = max(1, (stop - first) // BAR_PICTURES)
    filmed = filmed_part(islice(pictures or decoded(), 0, None, step))
    return lambda: (filmed.alone(picture) for picture in pictures or decoded()), filmed


def _path(camera: CameraMotionEstimate) -> dict[str, np.ndarray]:
    """The path as fields of the artifact; none where it is unknown."""
    if camera.path is None or camera.path_sd is None:
        return {}
    return {"path": camera.path, "path_sd": camera.path_sd}


if __name__ == "__main__":
    raise SystemExit(stage_main("camera_motion"))

"""What action.yaml declares of a video, against the evidence: its file, and its keypoints.

A wrong size or focal length would put the performer kilometres away and pull every other video's
camera with it, so it ends the run with a sentence.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from imocap_core.camera.lens import Lens
from imocap_core.camera.projection import intrinsics
from imocap_core.io.video import SLOWED, VideoInfo
from imocap_core.limits import MAX_FOCAL, MIN_FOCAL
from imocap_core.pipeline.action import Declaration

FPS_TOLERANCE = 0.02  # 29.97 may be declared as 30
OUTSIDE, OUTSIDE_SHARE = 0.1, 0.3  # of the picture; of the points
LEAST_EXTENT_PX = 2.0  # of a person, in the frame where they are largest
LEAST_REACH = 0.25  # of the picture's width and height that all people of a clip reach


def check_declared(declared: Declaration, probed: VideoInfo | None, file: Path) -> None:
    """ValueError when size, fps or focal_px are not what the video's file says, or no camera's.

    file: the action.yaml, for messages.
    """
    where = f"{file}: videos.{declared.id}"
    if probed is not None and declared.size not in (None, probed.size):
        assert declared.size is not None
        raise ValueError(
            f"{where}.size: expected {list(probed.size)}, as {declared.video} has, got "
            f"{list(declared.size)}; leave size out where there is a video"
        )
    if probed is not None and declared.fps is not None:
        off = _times_off(declared.fps, probed)
        if FPS_TOLERANCE < off - 1 < SLOWED - 1:
            raise ValueError(
                f"{where}.fps: expected {probed.fps:g}, as {declared.video} has, got "
                f"{declared.fps:g}; leave fps out where there is a video, unless it is slow motion "
                f"or a time lapse, {SLOWED} times slower or faster than it was taken"
            )
    size = declared.size if probed is None else probed.size
    if declared.focal_px is not None and size is not None:
        least, most = MIN_FOCAL * max(size), MAX_FOCAL * max(size)
        if not least <= declared.focal_px <= most:
            raise ValueError(
                f"{where}.focal_px: expected {least:.0f} to {most:.0f} pixels for pictures of "
                f"{size[0]} x {size[1]}, got {declared.focal_px:g}; leave it out where it is not "
                f"known"
            )
        _check_lens(declared, size, where)


def at_declared_rate(declared: Declaration, probed: VideoInfo) -> VideoInfo:
    """A file with the rate at which it was taken, where action.yaml says that it was another."""
    if declared.fps is None or _times_off(declared.fps, probed) < SLOWED:
        return probed
    return probed.taken_at(declared.fps)


def _times_off(fps: float, probed: VideoInfo) -> float:
    """How many times slower or faster the file is, at least 1."""
    return max(fps / probed.fps, probed.fps / fps)


def _check_lens(declared: Declaration, size: tuple[int, int], where: str) -> None:
    """ValueError for a distortion that does not show the picture from side to side."""
    if declared.distortion is None or declared.focal_px is None:
        return
    lens = Lens.of(declared.distortion, intrinsics(declared.focal_px, size))
    if lens.reach_px < max(size) / 2:
        raise ValueError(
            f"{where}.distortion: expected a lens that shows pictures of {size[0]} x {size[1]}, "
            f"got one that turns back on itself {lens.reach_px:.0f} pixels from the middle; its "
            f"numbers belong to a focal length, which is focal_px: {declared.focal_px:g} here"
        )


def check_fits_picture(
    xy_px: Float[np.ndarray, "T K 2"], size: tuple[int, int], folder: Path, *, probed: bool
) -> None:
    """ValueError when many points are far outside the picture, or all in a small corner of it, as
    pixels of another size are.

    probed: the size is that of the video's file; then somebody may well be in the corner.
    """
    share = xy_px[np.isfinite(xy_px).all(axis=-1)] / np.array(size)
    outside = ((share < -OUTSIDE) | (share > 1 + OUTSIDE)).any(axis=-1)
    if not len(share):
        return
    present = xy_px[np.isfinite(xy_px).all(axis=-1).any(axis=1)]
    extent = np.nanmax(present, axis=1) - np.nanmin(present, axis=1)
    if extent.max() < LEAST_EXTENT_PX:
        raise ValueError(
            f"{folder}: expected a person, got points that lie on one spot in every frame; check "
            f"the detections"
        )
    in_corner = not probed and share.max() < LEAST_REACH
    if outside.mean() <= OUTSIDE_SHARE and not in_corner:
        return
    x, y = (share.max(axis=0) * size).round().astype(int)
    raise ValueError(
        f"{folder}: expected pixels of a picture of {size[0]} x {size[1]}, got points that reach "
        f"({x}, {y}); run the detector on this very video, or correct `size` in action.yaml"
    )

"""A camera by its background: its lens corrected, its motion, and its path where it walks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from imocap_core.artifacts.schemas import LensDistortion, VideoKeypoints
from imocap_core.camera.background import Matches
from imocap_core.camera.line_lens import lens_from_lines
from imocap_core.camera.motion import CameraMotionEstimate, estimate_camera_motion, static_camera
from imocap_core.camera.parallax import ParallaxTest
from imocap_core.camera.still_background import StillBackground
from imocap_core.camera.undistorted_background import undistorted_matches
from imocap_core.params import CameraMotionParams
from imocap_core.problem.lenses import (
    declared_lens,
    estimated_distortion,
    given_distortion,
    lens_words,
)
from imocap_core.problem.moving_camera import Background, followed


def camera_of_background(
    video: VideoKeypoints,
    matches: Sequence[Matches],
    threshold_px: float,
    background: Callable[[], Background],
    still: Callable[[], StillBackground],
    params: CameraMotionParams,
) -> tuple[CameraMotionEstimate, LensDistortion | None]:
    """The motion of a camera, as a pinhole camera's, and its lens.

    A declared lens is taken out of the matches first. Else it is estimated where a camera turns
    enough; where that is certain, the motion is estimated again without it. Of a camera that stands
    it is estimated from lines of the scene.

    Args:
        matches: of the background; threshold_px: largest error of one that counts as explained.
        background: follows the feature tracks, which a static camera does not need; still: the
            picture of what stands behind the person, which only a static camera has.
    """
    given = declared_lens(video)
    tested: list[tuple[Background, ParallaxTest]] = []

    def parallax() -> ParallaxTest:
        if not tested:
            tracked = background() if given is None else background().undistorted(given)
            tested.append((tracked, tracked.parallax(video.focal_px, straight=given is not None)))
        return tested[0][1]

    def estimate(of: Sequence[Matches]) -> CameraMotionEstimate:
        return estimate_camera_motion(
            of,
            video.size,
            video.focal_px,
            assumed_focal_factor=params.assumed_focal_factor,
            threshold_px=threshold_px,
            parallax=parallax,
        )

    if given is not None:
        matches = undistorted_matches(matches, given, threshold_px)
    camera = estimate(matches)
    turning = tested[0][1].lens if tested and params.lens else None
    if turning is not None and turning.certain:
        lens, _ = turning.lens(camera.K, video.size)
        camera = estimate(undistorted_matches(matches, lens, threshold_px))
    if tested and params.structure:
        camera = followed(camera, tested[0][0], video.focal_px)
    distortion = None
    if given is not None:
        distortion = given_distortion(given, camera.K)
    elif turning is not None and turning.certain:
        distortion = estimated_distortion(turning, camera.K, video.size)
    elif camera.motion == "static" and params.lens:
        lines = lens_from_lines(still())
        if lines is not None and lines.certain:
            distortion = estimated_distortion(lines, camera.K, video.size)
    return with_lens(camera, distortion, video), distortion


def without_pictures(
    video: VideoKeypoints, assumed_focal_factor: float
) -> tuple[CameraMotionEstimate, LensDistortion | None]:
    """A camera of which there are keypoints only: taken to be static, its lens as declared."""
    camera = static_camera(len(video.frames), video.size, video.focal_px, assumed_focal_factor)
    given = declared_lens(video)
    lens = None if given is None else given_distortion(given, camera.K)
    return with_lens(camera, lens, video), lens


def with_lens(
    camera: CameraMotionEstimate, lens: LensDistortion | None, video: VideoKeypoints
) -> CameraMotionEstimate:
    """The camera with a note on its lens."""
    if lens is None:
        return camera
    return replace(camera, note=f"{camera.note}; {lens_words(lens, video.size, camera.K)}")

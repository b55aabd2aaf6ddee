"""A camera by its background: its motion, and its path where it walks.

A camera that leaves its place: found by its background's parallax, and followed where it can be.
Structure from motion needs the optional extra `moving` (pycolmap). Its unit of length is any; the
performer's size and feet give it metres later (`path_unit`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, UInt8

from imocap_core.adapters import lenses
from imocap_core.artifacts.schemas import LensDistortion, VideoKeypoints
from imocap_core.camera.background import FeatureTracks, Matches, track_features
from imocap_core.camera.camera_motion import (
    CameraMotionEstimate,
    estimate_camera_motion,
    static_camera,
)
from imocap_core.camera.camera_path import LEAST_REGISTERED, CameraPath, camera_path
from imocap_core.camera.line_lens import StillBackground, lens_from_lines
from imocap_core.camera.parallax import ParallaxTest, parallax_test
from imocap_core.camera.projection import Lens, intrinsics
from imocap_core.io.colmap import colmap_installed, reconstruct
from imocap_core.params import CameraMotionParams

KEYS_PER_S, FEWEST_KEYS, MOST_KEYS = 6.0, 16, 60


@dataclass(frozen=True)
class Background:
    """Feature tracks of a video's background, in its pictures made smaller by ``scale``.

    size: of the video's own pictures; frames: tracked ones.
    """

    tracks: FeatureTracks
    frames: int
    fps: float
    size: tuple[int, int]
    scale: float

    @property
    def small(self) -> tuple[int, int]:
        """Size of the pictures that were tracked in."""
        width, height = (round(side * self.scale) for side in self.size)
        return width, height

    def undistorted(self, lens: Lens) -> Background:
        """As a pinhole camera would show it; lens: of the video's own pictures."""
        return replace(self, tracks=self.tracks.undistorted(lens.rescaled(self.scale)))

    def parallax(self, focal_px: float | None, *, straight: bool = False) -> ParallaxTest:
        """The test for parallax.

        Args:
            focal_px: in the video's own pictures, where it is given.
            straight: whether the background is known to have no distortion.
        """
        focal = focal_px * self.scale if focal_px else None
        return parallax_test(self.tracks, self.frames, self.small, focal, straight=straight)

    def path(self, start_px: float, *, refine_focal: bool) -> CameraPath | None:
        """The camera's path; start_px: focal length, in the video's own pictures."""
        count = int(np.clip(KEYS_PER_S * self.frames / self.fps, FEWEST_KEYS, MOST_KEYS))
        keys = np.unique(np.linspace(0, self.frames - 1, count).round().astype(int)).tolist()
        start = start_px * self.scale
        structure = reconstruct(self.tracks, keys, self.small, start, refine_focal=refine_focal)
        if structure is None or len(structure.keys) < LEAST_REGISTERED * len(keys):
            return None
        path = camera_path(structure, self.tracks, self.frames, self.small)
        return None if path is None else replace(path, focal_px=path.focal_px / self.scale)


def background_of(
    pictures: Iterable[UInt8[np.ndarray, "H W"]],
    box_px: Float[np.ndarray, "T 4"],
    fps: float,
    size: tuple[int, int],
    scale: float,
    params: CameraMotionParams,
) -> Background:
    """Feature tracks of small grey pictures; box_px: the person in them."""
    tracks = track_features(pictures, box_px, fps, max_features=params.max_features)
    return Background(tracks.without_graphics(), len(box_px), fps, size, scale)


def followed(
    camera: CameraMotionEstimate, background: Background, focal_px: float | None
) -> CameraMotionEstimate:
    """A translating camera with its path, or with the reason why it has none."""
    if camera.motion != "translating":
        return camera
    if not colmap_installed():
        advice = "`pip install 'imocap[moving]'` adds what finds its path"
        return replace(camera, note=f"{camera.note}; {advice}")
    start = focal_px or float(camera.K[0, 0])
    path = background.path(start, refine_focal=focal_px is None)
    if path is None:
        why = "its path could not be reconstructed from the background"
        return replace(camera, note=f"{camera.note}; {why}")
    return _with_path(camera, path, background.size)


def _with_path(
    camera: CameraMotionEstimate, path: CameraPath, size: tuple[int, int]
) -> CameraMotionEstimate:
    """The camera along its path: keypoints are warped by its rotations."""
    K = intrinsics(path.focal_px, size)
    R = path.R_first_from_frame
    note = camera.note.split("; keypoints are warped")[0]
    return replace(
        camera,
        K=K,
        focal_source=camera.focal_source if camera.focal_source == "given" else "structure",
        H_first_from_frame=K @ R @ np.linalg.inv(K),
        R_first_from_frame=R,
        residual_px=path.off_px,
        path=path.centre,
        path_sd=path.sd,
        note=f"{note}; its path was reconstructed ({path.off_px:.1f} px off)",
    )


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
    given = lenses.declared_lens(video)
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
        matches = [match.undistorted(given, threshold_px) for match in matches]
    camera = estimate(matches)
    turning = tested[0][1].lens if tested and params.lens else None
    if turning is not None and turning.certain:
        lens, _ = turning.lens(camera.K, video.size)
        camera = estimate([match.undistorted(lens, threshold_px) for match in matches])
    if tested and params.structure:
        camera = followed(camera, tested[0][0], video.focal_px)
    distortion = None
    if given is not None:
        distortion = lenses.given_distortion(given, camera.K)
    elif turning is not None and turning.certain:
        distortion = lenses.estimated_distortion(turning, camera.K, video.size)
    elif camera.motion == "static" and params.lens:
        lines = lens_from_lines(still())
        if lines is not None and lines.certain:
            distortion = lenses.estimated_distortion(lines, camera.K, video.size)
    return with_lens(camera, distortion, video), distortion


def without_pictures(
    video: VideoKeypoints, assumed_focal_factor: float
) -> tuple[CameraMotionEstimate, LensDistortion | None]:
    """A camera of which there are keypoints only: taken to be static, its lens as declared."""
    camera = static_camera(len(video.frames), video.size, video.focal_px, assumed_focal_factor)
    given = lenses.declared_lens(video)
    lens = None if given is None else lenses.given_distortion(given, camera.K)
    return with_lens(camera, lens, video), lens


def with_lens(
    camera: CameraMotionEstimate, lens: LensDistortion | None, video: VideoKeypoints
) -> CameraMotionEstimate:
    """The camera with a note on its lens."""
    if lens is None:
        return camera
    return replace(camera, note=f"{camera.note}; {lenses.lens_words(lens, video.size, camera.K)}")

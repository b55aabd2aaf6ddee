"""A camera that leaves its place: found by its background's parallax, and followed where it can be.

Structure from motion needs the optional extra `moving` (pycolmap). Its unit of length is any; the
performer's size and feet give it metres later (`path_unit`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, UInt8

from imocap_core.camera.camera_path import LEAST_REGISTERED, CameraPath, camera_path
from imocap_core.camera.feature_tracks import FeatureTracks, track_features
from imocap_core.camera.lens import Lens
from imocap_core.camera.motion import CameraMotionEstimate
from imocap_core.camera.parallax import ParallaxTest, parallax_test
from imocap_core.camera.projection import intrinsics
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
    return Background(tracks, len(box_px), fps, size, scale)


def followed(
    camera: CameraMotionEstimate, background: Background, focal_px: float | None
) -> CameraMotionEstimate:
    """A translating camera with its path, or with the reason why it has none."""
    if camera.motion != "translating":
        return camera
    if not colmap_installed():
        advice = "its path is unknown: `pip install 'imocap[moving]'` adds what finds it"
        return replace(camera, note=f"{camera.note}; {advice}")
    start = focal_px or float(camera.K[0, 0])
    path = background.path(start, refine_focal=focal_px is None)
    if path is None:
        why = "its path could not be reconstructed from the background"
        return replace(camera, note=f"{camera.note}; {why}")
    return with_path(camera, path, background.size)


def with_path(
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

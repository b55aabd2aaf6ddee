"""The camera of one video: where it stands, how it turns and zooms, and what it sees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from imocap_core.camera.lens import Lens
from imocap_core.camera.projection import camera_from_world

STILL = 1e-9  # a camera whose rotations differ by less is static


@dataclass(frozen=True, eq=False)
class VideoCamera:
    """A camera, which may turn, zoom and move; OpenCV's axes (x right, y down, z forward),
    pixels, metres.

    Attributes:
        id: the video.
        size: width and height of the picture, pixels.
        K: intrinsics (3, 3) of the first used frame, pixels.
        R, t: camera from world in the first used frame: x_cam = R x_world + t, t in metres.
        R_first_from_frame: (T, 3, 3) rotation from each frame's camera axes to the first frame's.
        zoom: (T,) focal length of each frame over the first frame's.
        H_first_from_frame: (T, 3, 3) homographies from each frame's pixels to the first frame's,
            as they were measured on the background.
        path_m: (T, 3) its places in the first frame's axes, metres; None on one spot, or where the
            path is unknown.
        lens: its distortion; None: a pinhole. A zoom moves pixels as the first frame's lens does.
            K, R, t, H_first_from_frame and P_frame_from_first are of pictures without it.
    """

    id: str
    size: tuple[int, int]
    K: Float[np.ndarray, "3 3"]
    R: Float[np.ndarray, "3 3"]
    t: Float[np.ndarray, " 3"]
    R_first_from_frame: Float[np.ndarray, "T 3 3"]
    zoom: Float[np.ndarray, " T"]
    H_first_from_frame: Float[np.ndarray, "T 3 3"]
    path_m: Float[np.ndarray, "T 3"] | None = None
    lens: Lens | None = None

    @property
    def distortion(self) -> Float[np.ndarray, " 5"]:
        """OpenCV's k1, k2, p1, p2, k3, relative to K; 0 for a pinhole."""
        return self.distortion_at(self.K)

    def distortion_at(self, K: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, " 5"]:
        """The same lens, relative to the focal length of another zoom."""
        return np.zeros(5) if self.lens is None else self.lens.relative_to(K).coefficients

    @property
    def is_static(self) -> bool:
        """Whether the camera neither turns, zooms nor moves."""
        if self.path_m is not None:
            return False
        turned = np.abs(self.R_first_from_frame - np.eye(3)).max() > STILL
        return not turned and float(np.ptp(self.zoom)) <= STILL

    @property
    def centre(self) -> Float[np.ndarray, " 3"]:
        """Position of the camera in the world in the first used frame, metres."""
        return -self.R.T @ self.t

    @property
    def centre_per_frame(self) -> Float[np.ndarray, "T 3"]:
        """Position of the camera in the world in every used frame, metres."""
        moved = np.zeros((len(self.zoom), 3)) if self.path_m is None else self.path_m
        return self.centre + moved @ self.R

    @property
    def t_per_frame(self) -> Float[np.ndarray, "T 3"]:
        """Translation camera from world of every used frame, metres."""
        return -np.einsum("tij,tj->ti", self.R_per_frame, self.centre_per_frame)

    @property
    def K_per_frame(self) -> Float[np.ndarray, "T 3 3"]:
        """Intrinsics of every used frame, pixels."""
        from imocap_core.camera.zooming import lens_of

        return lens_of(self.K, self.zoom)

    @property
    def R_per_frame(self) -> Float[np.ndarray, "T 3 3"]:
        """Rotation camera from world of every used frame."""
        return self.R_first_from_frame.swapaxes(1, 2) @ self.R

    @property
    def P_frame_from_first(self) -> Float[np.ndarray, "T 3 3"]:
        """From metres in the first frame's camera axes to homogeneous pixels of every frame:
        H_first_from_frame^-1 K, scaled so that the third coordinate is the depth for a camera
        that turns on the spot."""
        H_frame_from_first = np.linalg.inv(self.H_first_from_frame)
        scale = np.cbrt(np.linalg.det(H_frame_from_first))[:, None, None]
        return np.asarray(H_frame_from_first / scale @ self.K)

    def project(
        self, points_m: Float[np.ndarray, "... 3"], index: Int[np.ndarray, " F"] | None = None
    ) -> Float[np.ndarray, "F N 2"]:
        """Pixels of world points in every used frame, or in the used frames `index`, as the lens
        shows them.

        Args:
            points_m: (N, 3) metres, the same points for all frames, or (F, N, 3), those of each.
            index: (F,) positions among the used frames; all T of them when left out.

        NaN for points not in front of the camera.
        """
        P = self.P_frame_from_first if index is None else self.P_frame_from_first[index]
        ahead = camera_from_world(points_m, self.R, self.t)
        if self.path_m is not None:
            path = self.path_m if index is None else self.path_m[index]
            ahead = ahead - path[:, None]
        homogeneous = np.broadcast_to(ahead, (len(P), *ahead.shape[-2:])) @ P.swapaxes(1, 2)
        depth = np.where(homogeneous[..., 2:] > 0, homogeneous[..., 2:], np.nan)
        straight = np.asarray(homogeneous[..., :2] / depth)
        return straight if self.lens is None else self.lens.distorted(straight)

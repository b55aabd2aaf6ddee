"""The lens of a video: declared, or estimated from the camera's turning or lines of the scene."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from imocap_core.artifacts.schemas import CameraMotion, LensDistortion, RefineSync, VideoKeypoints
from imocap_core.camera.line_lens import LineLens
from imocap_core.camera.projection import Lens, intrinsics
from imocap_core.camera.tripod import TurningLens

EVIDENCE = {"rotation": "its turning", "lines": "straight lines of the scene"}


def declared_lens(video: VideoKeypoints) -> Lens | None:
    """The lens that action.yaml gives with a focal length."""
    if video.distortion is None or video.focal_px is None:
        return None
    return Lens.of(video.distortion, intrinsics(video.focal_px, video.size))


def given_distortion(lens: Lens, K: Float[np.ndarray, "3 3"]) -> LensDistortion:
    """A declared lens, relative to the focal length in K."""
    return LensDistortion(source="given", coefficients=lens.relative_to(K).coefficients)


def estimated_distortion(
    estimate: TurningLens | LineLens, K: Float[np.ndarray, "3 3"], size: tuple[int, int]
) -> LensDistortion:
    """An estimated lens, relative to the focal length in K."""
    lens, k1_sd = estimate.lens(K, size)
    return LensDistortion(source=estimate.source, coefficients=lens.coefficients, k1_sd=k1_sd)


def lens_from(distortion: LensDistortion | None, K: Float[np.ndarray, "3 3"]) -> Lens | None:
    """The lens of a camera whose intrinsics are K; None for a pinhole."""
    return None if distortion is None else Lens(distortion.coefficients, K)


def undistorted_px(
    xy_px: Float[np.ndarray, "*N 2"], distortion: LensDistortion | None, K: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "*N 2"]:
    """Pixels of a video as its camera would show them without distortion."""
    lens = lens_from(distortion, K)
    return xy_px if lens is None else lens.undistorted(xy_px)


def lenses_of(cameras: CameraMotion, refined: RefineSync | None) -> dict[str, Lens]:
    """The lenses of all videos that have one: corrected from the first, else calibrated from one
    event."""
    lenses = {}
    if refined is not None and refined.event is not None:
        K = {camera.id: camera.K for camera in refined.motion.cameras}
        for camera in refined.event.cameras:
            if camera.distortion:
                lenses[camera.id] = Lens.of([camera.distortion], K[camera.id])
    for video in cameras.videos:
        if video.lens is not None:
            lenses[video.id] = Lens(video.lens.coefficients, video.K)
    return lenses


def lens_words(lens: LensDistortion, size: tuple[int, int], K: Float[np.ndarray, "3 3"]) -> str:
    """What was done about a lens, as part of a note."""
    corner = np.array([[0.0, 0.0]])
    moved = np.linalg.norm(Lens(lens.coefficients, K).undistorted(corner) - corner)
    share = moved / np.linalg.norm((np.array(size) - 1) / 2)
    k1 = float(lens.coefficients[0])
    if lens.source == "given":
        return f"its lens is corrected as declared (k1 {k1:.3f}, {share:.0%} in the corners)"
    return (
        f"its lens was estimated from {EVIDENCE[lens.source]} and is corrected "
        f"(k1 {k1:.3f} +- {lens.k1_sd:.3f}, {share:.0%} in the corners)"
    )

"""Artifact of `camera_motion`: rotation and zoom, keypoints warped into the first frame."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from imocap_core.artifacts.schemas.base import Artifact, Floats, Ints, Shape, Value
from imocap_core.identifiers import Id


class LensDistortion(Value):
    """Distortion of a lens, in OpenCV's convention, relative to the focal length in K."""

    OPTIONAL: ClassVar[frozenset[str]] = frozenset({"k1_sd"})

    source: Literal["given", "rotation", "lines"]
    coefficients: Annotated[Floats, Shape(5)]  # k1, k2, p1, p2, k3
    k1_sd: float | None = None  # standard deviation of an estimate


class VideoCameraMotion(Value):
    """One camera. "first" is the first used frame of its video.

    All but the video's keypoints is of pictures without distortion: where there is a lens, points
    are undistorted before anything else.
    """

    OPTIONAL: ClassVar[frozenset[str]] = frozenset({"lens"})

    id: Id
    K: Annotated[Floats, Shape(3, 3)]  # of the first frame
    focal_source: Literal["given", "rotation", "structure", "assumed"]
    motion: Literal["static", "rotating", "zooming", "translating", "unknown"]
    note: str
    residual_px: float  # how far the homographies are from a pure rotation's K R K^-1
    H_first_from_frame: Annotated[Floats, Shape("T", 3, 3)]
    R_first_from_frame: Annotated[Floats, Shape("T", 3, 3)]
    zoom: Annotated[Floats, Shape("T")]  # each frame's focal length over the first one's
    inliers: Annotated[Ints, Shape("T")]
    xy_first_px: Annotated[Floats, Shape("T", "K", 2)]  # keypoints warped into the first frame
    # of a camera that moves from its place: its places in the first frame's axes, in a unit that
    # initial_smpl gives in metres, and their standard deviations; empty where none is known
    path: Annotated[Floats, Shape("P", 3)] = Field(default_factory=lambda: np.zeros((0, 3)))
    path_sd: Annotated[Floats, Shape("P")] = Field(default_factory=lambda: np.zeros(0))
    lens: LensDistortion | None = None  # None: taken to be a pinhole


class CameraMotion(Artifact):
    """The cameras' own motion, one entry per video, in the order of the keypoints."""

    videos: list[VideoCameraMotion]

"""Artifact of `camera_motion`: rotation and zoom, keypoints warped into the first frame."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from imocap_core.artifacts.schemas.base import Artifact, Floats, Ints, Shape, Value
from imocap_core.identifiers import Id


class VideoCameraMotion(Value):
    """One camera. "first" is the first used frame of its video."""

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


class CameraMotion(Artifact):
    """The cameras' own motion, one entry per video, in the order of the keypoints."""

    videos: list[VideoCameraMotion]

"""Artifact of `uncertainty`: standard deviations of joints, what the videos do not determine."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from imocap_core.artifacts.schemas.base import Artifact, Floats, Floats32, Ints, Shape, Value
from imocap_core.identifiers import Id


class VideoUncertainty(Value):
    """One video, in the axes of its first-frame camera; joints about the middle of the hips."""

    id: Id
    frames: Annotated[Ints, Shape("T")]  # source frame numbers
    sigma_mm: Annotated[Floats, Shape("T", 24)]  # root of the covariance's trace
    depth_mm: Annotated[Floats, Shape("T", 24)]  # along the line of sight to the performer
    across_mm: Annotated[Floats, Shape("T", 24)]  # the two directions across it together
    covariance_mm2: Annotated[Floats32, Shape("T", 24, 3, 3)]
    # Of the anatomical joints (`biomechanics/joint_angles.py`), in the axes of the distal segment
    rotation_covariance_deg2: Annotated[Floats32, Shape("T", 15, 3, 3)]
    azimuth_deg: float  # of its camera about the performer; excluded: by its own motion, or NaN
    camera_rotation_deg: float = float("nan")  # about the reference's camera, three axes together


class WeakSpan(Value):
    """A time span in which a joint is ill-determined."""

    video: str
    joint: str
    first_frame: int  # source frames, both within
    last_frame: int
    begin_s: float
    end_s: float
    sigma_mm: float  # root mean square over the span
    of_median: float  # as a multiple of the action's median


class NearPair(Value):
    """Two videos that see the performer from nearly the same side."""

    videos: list[str]
    angle_deg: float
    seen_across: bool  # whether another video looks across their line of sight


class Viewpoint(Value):
    """One more camera, and by how much it would help."""

    azimuth_deg: float
    reduction: float  # share of the common motion's summed joint variance


class PredictedVideo(Value):
    """How well a video's keypoints are predicted without it, in the held-out stretches of time.

    Medians, as shares of the person's height in the picture; NaN where nothing is predicted.
    """

    id: Id
    error_share: float  # by the other videos' motion, its camera resected; NaN: excluded
    near_share: float  # share of the keypoints whose error is below 0.1
    monocular_error_share: float  # of limbs, each hidden from the video's own monocular fit
    frames: int  # that the other videos predict


class Uncertainty(Artifact):
    """Standard deviations of every joint and the observability report."""

    videos: list[VideoUncertainty]
    median_mm: float  # of 14 joints in all frames of all videos
    weak: list[WeakSpan]  # worst first
    near: list[NearPair]
    near_limit_deg: float
    weak_limit: float  # times the median
    viewpoints: list[Viewpoint]
    azimuth_from: Literal["performer", "camera"]  # what azimuth 0 faces; 90 is the performer's left
    status: str
    leave_one_out: list[PredictedVideo] = Field(default_factory=list)  # none of a single video

"""Artifacts of what looks at one video: `keypoints`, `camera_motion`, `redetect`."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from jaxtyping import Float, Real
from pydantic import Field, model_validator

from imocap_core.artifacts.schemas.base import Artifact, Floats, Ints, Shape, Value, unique
from imocap_core.identifiers import Id


class HandKeypoints(Value):
    """Both hands, left first, OpenPose's 21 points each; NaN with confidence 0 where undetected."""

    xy_px: Annotated[Floats, Shape("T", 2, 21, 2)]
    confidence: Annotated[Floats, Shape("T", 2, 21)]


class CorrectedMarks(Value):
    """Keypoints moved to the points of the body that their layout gives."""

    xy_px: Annotated[Floats, Shape("T", "K", 2)]


class SourceMoments(Value):
    """Where even moments lie in a file of variable frame rate."""

    position: Annotated[Floats, Shape("T")]  # fractional source frames
    time_s: Annotated[Floats, Shape("T")]  # presentation times


class VideoKeypoints(Value):
    """One video's detections. A joint that was not detected is NaN with confidence 0.

    A used frame is one of the source or, of a file of variable frame rate, one of even moments.
    """

    OPTIONAL: ClassVar[frozenset[str]] = frozenset(
        {
            *("hands", "damaged", "moments", "corrected", "performer", "distortion"),
            *("joints_m", "mirrored"),
        }
    )

    id: Id
    fps: float  # used frames a second
    size: tuple[int, int]  # width, height
    layout: str  # which joints: body25, body25b, coco17, ...
    video: str | None  # as written in action.yaml, relative to its folder
    focal_px: float | None  # given by the user; None when unknown
    initial: str | None
    initial_format: str | None
    frames: Annotated[Ints, Shape("T")]  # source frame numbers, of moments the nearest
    xy_px: Annotated[Floats, Shape("T", "K", 2)]
    confidence: Annotated[Floats, Shape("T", "K")]
    person_box_px: Annotated[Floats, Shape("T", 4)]  # x0 y0 x1 y1, NaN where undetected
    tracks_found: int  # people followed before the performer was chosen
    presence: float  # share of frames in which the performer was found
    note: str
    hands: HandKeypoints | None = None  # None when no frame has any
    damaged: list[tuple[int, int]] | None = None  # source frames, first and last: undecodable
    moments: SourceMoments | None = None  # None where the frame rate is constant
    corrected: CorrectedMarks | None = None  # None where the keypoints are as detected
    performer: Id | None = None  # as declared; None: the action has one
    distortion: tuple[float, ...] | None = None  # declared: OpenCV's k1, k2, p1, p2, k3
    # SMPL's joints by the detector itself, relative to the body, in axes of each frame's camera;
    # NaN where it has none. None: it estimates no 3D.
    joints_m: Annotated[Floats, Shape("T", 24, 3)] | None = None
    mirrored: bool | None = None  # True: the file has players show it in a mirror

    @model_validator(mode="after")
    def _every_frame_has_a_moment(self) -> VideoKeypoints:
        if self.moments is not None and len(self.moments.position) != len(self.frames):
            raise ValueError(
                f"moments: expected {len(self.frames)}, got {len(self.moments.position)}"
            )
        return self

    @property
    def marks_px(self) -> Float[np.ndarray, "T K 2"]:
        """The keypoints that a fit works on: corrected, or else as detected."""
        return self.xy_px if self.corrected is None else self.corrected.xy_px

    @property
    def source_frames(self) -> Real[np.ndarray, " T"]:
        """Source frame of every used frame, fractional where the frame rate is variable."""
        return self.frames if self.moments is None else self.moments.position

    def seconds_of(self, source_frame: Real[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
        """Seconds from the beginning of the file of (fractional) source frames."""
        if self.moments is None:
            return np.asarray(source_frame / self.fps)
        moments = self.moments
        return np.asarray(np.interp(source_frame, moments.position, moments.time_s))

    @property
    def time_s(self) -> Float[np.ndarray, " T"]:
        """Seconds from the beginning of the file of every used frame."""
        return self.seconds_of(self.source_frames)


class LeftOutVideo(Value):
    """A declared video that cannot be used: its declaration or its files are wrong."""

    id: Id
    reason: str


class Keypoints(Artifact):
    """2D joints, one entry per video, in the order of action.yaml."""

    OPTIONAL: ClassVar[frozenset[str]] = frozenset({"left_out"})

    videos: list[VideoKeypoints]
    left_out: list[LeftOutVideo] | None = None  # None when every declared video takes part

    @model_validator(mode="after")
    def _ids(self) -> Keypoints:
        unique([v.id for v in (*self.videos, *(self.left_out or ()))])
        return self


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


class RedetectedVideo(Value):
    """One video's keypoints that replace those of the stage keypoints.

    A replacement with confidence 0 is a point that went with a joint that was moved.
    """

    id: Id
    looked_at: Annotated[
        Ints, Shape("L")
    ]  # used frames, numbered from 0, that were looked at again
    contradicted: int  # doubtful joints, detected where the other videos do not have them
    frame: Annotated[Ints, Shape("C")]  # used frame of each replacement, numbered from 0
    point: Annotated[Ints, Shape("C")]  # and its point of the layout
    xy_px: Annotated[Floats, Shape("C", 2)]  # in the frame's picture
    xy_first_px: Annotated[Floats, Shape("C", 2)]  # warped into the first frame
    confidence: Annotated[Floats, Shape("C")]


class Redetect(Artifact):
    """The videos that were looked at again; empty where nothing had to be, or nothing can look."""

    videos: list[RedetectedVideo]
    note: str  # why none was; empty where some were

"""Artifact of `keypoints`: the performer's 2D joints in every used frame of every video."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from jaxtyping import Float, Real
from pydantic import model_validator

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

"""Artifacts of motion: `initial_smpl`, `smpl_ba`, `hands`, `uncertainty`; tables of `evaluate`."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from imocap_core.artifacts.schemas.base import Artifact, Floats, Floats32, Ints, Shape, Value
from imocap_core.identifiers import Id


class VideoMotion(Value):
    """SMPL parameters for every used frame, in the axes of this video's first-frame camera."""

    id: Id
    frames: Annotated[Ints, Shape("T")]  # source frame numbers
    theta: Annotated[Floats, Shape("T", 72)]  # axis-angle radians, joint 0 about the pelvis
    betas: Annotated[Floats, Shape(10)]
    trans: Annotated[Floats, Shape("T", 3)]  # metres, as in smplx
    joints: Annotated[Floats, Shape("T", 24, 3)]  # metres
    reprojection_px: Annotated[Floats, Shape("T")]


class Camera(Value):
    """x_cam = R x_world + t; the world is the first-frame camera of the reference video."""

    id: Id
    K: Annotated[Floats, Shape(3, 3)]  # an assumed focal length is solved with the motion
    R: Annotated[Floats, Shape(3, 3)]
    t: Annotated[Floats, Shape(3)]  # metres; both of the first frame
    # of a camera that moves from its place: its places in its first frame's axes, metres
    path_m: Annotated[Floats, Shape("P", 3)] = Field(default_factory=lambda: np.zeros((0, 3)))


class StartFit(Value):
    """The monocular fit of one video from one of its starts."""

    video: str
    name: str
    cost: float  # objective
    chosen: bool


class AlternativeMotion(Value):
    """Another motion that may explain a video (depth, facing or sides reversed, another start)."""

    name: str  # of the start that led to it
    excess_cost: float  # a frame, of objective and gravity, above the video's motion
    motion: VideoMotion


class GroundPlane(Value):
    """The ground: points x with up . (x - origin) = 0. Its height is NaN where no body tells it."""

    up: Annotated[Floats, Shape(3)]  # unit vector against gravity
    origin: Annotated[Floats, Shape(3)]  # under the bodies' mean place, metres
    tilt_sd_deg: float  # of up about each horizontal axis
    height_sd_mm: float


class PathUnit(Value):
    """The unit of a moving camera's path in metres, from the performer's size and feet."""

    id: Id
    unit_m: float
    relative_sd: float  # of the unit


class InitialSmpl(Artifact):
    """The monocular start: each video's motion from that video alone."""

    model: str
    model_digest: str
    videos: list[VideoMotion]
    source: dict[str, str]  # video id -> its initial_format | monocular
    starts: list[StartFit] = Field(default_factory=list)
    # of the videos without an estimate; `videos` are the motions of lowest cost
    alternatives: list[AlternativeMotion] = Field(default_factory=list)
    # each video's by itself, in the order of `videos`, in the axes of its first-frame camera
    grounds: list[GroundPlane] = Field(default_factory=list)
    # of the cameras whose path is known
    path_units: list[PathUnit] = Field(default_factory=list)
    # by video id, of limbs, each hidden from the video's own fit: median share of the height
    limb_errors: dict[str, float] = Field(default_factory=dict)


class CommonMotion(Value):
    """The motion common to M videos, at the N used frames of the reference, in the world's axes.

    As it was solved: mirrored videos are reflected, excluded ones are not among `ids`. Spreads are
    standard deviations of each video's performance from this motion. Keypoints are those of the
    fit: of every layout in use, the ones that the body model has.
    """

    OPTIONAL: ClassVar[frozenset[str]] = frozenset({"other_betas"})

    ids: list[Id]
    theta: Annotated[Floats, Shape("N", 72)]  # axis-angle radians, joint 0 about the pelvis
    betas: Annotated[Floats, Shape(10)]  # of the first video's performer
    trans: Annotated[Floats, Shape("N", 3)]  # metres, as in smplx
    rigid_offset_sd: Annotated[Floats, Shape("M", 6)]  # of every frame: rad three times, m three
    keypoint_sd_m: Annotated[Floats, Shape("M", "N", "K")]  # per coordinate
    other_betas: Annotated[Floats, Shape("P", 10)] | None = None  # of the other performers


class SmplBa(Artifact):
    """Motion and cameras solved over all videos (Eq. 8)."""

    OPTIONAL: ClassVar[frozenset[str]] = frozenset({"common", "ground"})

    reference: str
    model: str
    model_digest: str
    videos: list[VideoMotion]
    cameras: list[Camera]
    objective: list[float]  # after each iteration
    misfit: float  # mean robust reprojection cost a keypoint of one motion for all views
    status: str
    common: CommonMotion | None = None  # None for a single video, and in refine_sync's rounds
    ground: GroundPlane | None = None  # in the world's axes; None in refine_sync's rounds


class VideoHands(Value):
    """One video's hands, left then right, in the axes of this video's first-frame camera."""

    id: Id
    frames: Annotated[Ints, Shape("T")]  # source frame numbers
    fingers: Annotated[Floats, Shape("T", 2, 15, 3)]  # axis-angle radians, SMPL+H's order
    wrists: Annotated[Floats, Shape("T", 2, 3)]  # axis-angle radians against the forearm
    points_m: Annotated[Floats, Shape("T", 2, 21, 3)]  # OpenPose's 21, metres
    visible: Annotated[Ints, Shape("T", 2)]  # 1 where keypoints were used


class Hands(Artifact):
    """Hands of all videos in the order of the keypoints; no video when no keypoints have hands."""

    videos: list[VideoHands]
    model: str  # body model that the fingers belong to; empty when there is no video
    model_digest: str
    size: float  # of the hands, as a factor of the model's with the performer's shape
    status: str


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
    # The same with the motion common to all videos given: of the video's deviation from it
    deviation_covariance_deg2: Annotated[Floats32, Shape("T", 15, 3, 3)]
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
    viewpoints: list[Viewpoint]
    azimuth_from: Literal["performer", "camera"]  # what azimuth 0 faces; 90 is the performer's left
    status: str
    leave_one_out: list[PredictedVideo] = Field(default_factory=list)  # none of a single video


Cell = str | bool | int | float | None  # None: could not be scored


class Table(Value):
    """Rows of equal length under named columns; units are part of a column's name."""

    name: str
    title: str
    columns: list[str]
    rows: list[list[Cell]]
    note: str = ""

    @model_validator(mode="after")
    def _rectangular(self) -> Table:
        for i, row in enumerate(self.rows):
            if len(row) != len(self.columns):
                raise ValueError(
                    f"table {self.name}: row {i} has {len(row)} cells, expected {len(self.columns)}"
                )
        return self


class Evaluate(Artifact):
    """Tables of metrics, and the files of report/."""

    tables: list[Table]
    files: list[str]  # relative to report/

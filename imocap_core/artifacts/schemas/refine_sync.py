"""Artifact of `refine_sync`: every round of sync and motion, and the best one."""

from __future__ import annotations

from typing import ClassVar

from imocap_core.artifacts.schemas.base import Artifact, Value
from imocap_core.artifacts.schemas.motion import SmplBa
from imocap_core.artifacts.schemas.sync import Sync, SyncSummary
from imocap_core.identifiers import Id


class Round(Value):
    """One alternation of synchronisation and joint solve."""

    sync: SyncSummary
    motion: SmplBa
    cost: float
    sync_change_frames: float  # mean movement of the correspondences since the round before


class EventCamera(Value):
    """A camera calibrated from one event: what `Camera` does not have, and the errors it claims."""

    id: Id
    # radial: a ray at r focal lengths from the axis is seen at r (1 + k r^2); 0: straight, or taken
    # out of the keypoints before (`lens` of camera_motion)
    distortion: float
    offset_frames: float  # frame of this video, among its used frames, at the reference's first
    rate: float  # frames of this video a frame of the reference
    median_px: float  # of the reprojection errors, the detector's constant ones taken off
    focal_sd: float  # of the focal length, as a share of it; 0: known
    rotation_sd_deg: float  # about all three axes together; 0 for the reference
    offset_sd_s: float


class EventCameras(Value):
    """The calibration of all videos that take part."""

    cameras: list[EventCamera]
    status: str


class RefineSync(Artifact):
    """The alternation's history and its result."""

    OPTIONAL: ClassVar[frozenset[str]] = frozenset({"event"})

    rounds: list[Round]
    best: int  # index into rounds
    sync: Sync  # of the best round, or from its motion where the loop settled
    motion: SmplBa
    status: str
    event: EventCameras | None = None  # where all videos show one event

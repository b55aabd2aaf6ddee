"""Artifacts of `sync` and `refine_sync`: correspondences, and the rounds of the loop."""

from __future__ import annotations

from math import nan
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, model_validator

from imocap_core.artifacts.schemas.base import (
    Artifact,
    Floats,
    Floats32,
    Ints,
    Ints16,
    Shape,
    Value,
    unique,
)
from imocap_core.artifacts.schemas.motion_schemas import SmplBa
from imocap_core.identifiers import Id


class SyncMap(Value):
    """One video against the reference (the reference itself has the identity)."""

    id: str
    reference_frame: Annotated[Floats, Shape("T")]  # index into the reference's used frames, or NaN
    confidence: Annotated[Floats, Shape("T")]  # 0 to 1


class VideoTrust(Value):
    """One video's place on the common time axis, and evidence for and against it; NaN where
    unknown."""

    id: str
    phase_s: Annotated[Floats, Shape("T")]  # seconds of the reference
    outlier_score: float  # above 1.1 is another action, below 0.9 is usual
    mirror_margin: float  # > 0 when it fits the others better reflected
    left_out_frames: float  # direct map to the reference against that through the others
    left_out_s: float
    left_out_share: float  # of its frames that both ways match
    # the map shifted by a repetition that fits best: later in the reference by this, and its
    # squared distance over the map's; NaN where the motion does not repeat
    repetition_s: float = nan
    repetition_ratio: float = nan
    phase_confidence: Annotated[Floats, Shape("T")] | None = None  # that another shows the moment


class CycleTriple(Value):
    """Cycle error of three videos: distance from the start after following their pairwise maps."""

    videos: list[str]
    frames: float  # of the first video
    seconds: float
    share: float  # of the frames that the three maps carry back


class SyncTrust(Value):
    """How far the correspondences can be trusted, estimated without ground truth."""

    videos: list[VideoTrust]
    triples: list[CycleTriple]


class SyncSummary(Value):
    """Correspondences without the matrices they were read from."""

    reference: str
    ids: list[str]
    lengths: list[int]  # used frames of each video
    maps: list[SyncMap]
    method: str
    centrality: Annotated[Floats, Shape("M")]  # one a video; the reference has the largest
    status: str
    excluded: list[str] = Field(default_factory=list)  # another action: unmatched throughout
    mirrored: list[str] = Field(default_factory=list)  # treated as their mirror image
    notes: list[str] = Field(default_factory=list)  # what was noticed about the videos, and done
    trust: SyncTrust | None = None
    # video id -> name of the alternative motion that is used in place of the first
    alternatives: dict[str, str] = Field(default_factory=dict)

    @property
    def used(self) -> list[str]:
        """The videos that take part."""
        return [i for i in self.ids if i not in self.excluded]

    @property
    def trusts(self) -> dict[str, VideoTrust]:
        """Each video's place on the common time axis and its evidence; none where unknown."""
        return {} if self.trust is None else {v.id: v for v in self.trust.videos}

    @property
    def phases(self) -> dict[str, Floats]:
        """Each video's place on the common time axis, seconds of the reference; none likewise."""
        return {video: trust.phase_s for video, trust in self.trusts.items()}

    def map_of(self, video: str) -> SyncMap:
        """A video's map into the reference."""
        return next(m for m in self.maps if m.id == video)

    @model_validator(mode="after")
    def _belongs_together(self) -> SyncSummary:
        unique(self.ids)
        if self.reference not in self.ids:
            raise ValueError(f"reference: expected one of {self.ids}, got {self.reference!r}")
        if [m.id for m in self.maps] != self.ids:
            raise ValueError(f"maps: expected those of {self.ids}, got {[m.id for m in self.maps]}")
        lengths = [len(m.reference_frame) for m in self.maps]
        if lengths != self.lengths:
            raise ValueError(f"maps: expected lengths {self.lengths}, got {lengths}")
        unknown = sorted({*self.excluded, *self.mirrored} - {*self.ids})
        if unknown:
            raise ValueError(f"excluded, mirrored: expected some of {self.ids}, got {unknown}")
        if self.reference in self.excluded:
            raise ValueError(
                f"excluded: expected videos beside the reference, got {self.reference!r}"
            )
        phases = [len(phase_s) for phase_s in self.phases.values()]
        if self.trust is not None and phases != self.lengths:
            raise ValueError(f"trust: expected phases of lengths {self.lengths}, got {phases}")
        return self


FRAMES = 32  # of a block of a soft map


class AffinityBlock(Value):
    """Affinities (Eq. 1) of two videos' frames: of every n-th of each, for pictures."""

    first: str
    second: str
    every: Annotated[Ints, Shape(2)]  # n of either video
    scaled: Annotated[Ints16, Shape("A", "B")]  # 0 to 65535 for 0 to 1


class SoftMapBands(Value):
    """Row-stochastic maps from every video to every other one, in the order of the ids.

    A map's frames come in blocks of 32; of each block the entries from its first to its last
    position above 1/10,000 of a row's largest, the others are left out.
    """

    position: Annotated[Ints, Shape("B")]  # the first one of each block
    width: Annotated[Ints, Shape("B")]
    entries: Annotated[Floats32, Shape("E")]  # of all blocks, each row by row


class Sync(Artifact, SyncSummary):
    """Correspondences with the affinities they came from (Eq. 2)."""

    OPTIONAL: ClassVar[frozenset[str]] = frozenset({"sound_start_s"})

    affinity: list[AffinityBlock]  # one a pair of videos; none of an excluded one
    relaxed: SoftMapBands
    # when each video of one event began, by its sound, NaN where that does not tell; else None
    sound_start_s: Annotated[Floats, Shape("M")] | None = None

    @model_validator(mode="after")
    def _bands_fit(self) -> Sync:
        M, blocks = len(self.lengths), [-(-T // FRAMES) for T in self.lengths]
        position, width = self.relaxed.position, self.relaxed.width
        rows, most = [], []
        for v, T in enumerate(self.lengths):
            sizes = [min(FRAMES, T - FRAMES * b) for b in range(blocks[v])]
            rows += sizes * (M - 1)
            most += [n for u, n in enumerate(self.lengths) if u != v for _ in sizes]
        if len(position) != len(rows):
            raise ValueError(f"relaxed: expected {len(rows)} bands, got {len(position)}")
        if ((position < 0) | (width < 0) | (position + width > np.array(most, dtype=int))).any():
            raise ValueError("relaxed: expected bands within the videos, got one beyond")
        if (expected := int(width @ np.array(rows, dtype=int))) != len(self.relaxed.entries):
            raise ValueError(
                f"relaxed: expected {expected} entries, got {len(self.relaxed.entries)}"
            )
        return self


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
    declared: bool = True  # in action.yaml; else the videos look like one event


class RefineSync(Artifact):
    """The alternation's history and its result."""

    OPTIONAL: ClassVar[frozenset[str]] = frozenset({"event"})

    rounds: list[Round]
    best: int  # index into rounds
    sync: Sync  # of the best round, or from its motion where the loop settled
    motion: SmplBa
    status: str
    event: EventCameras | None = None  # where all videos show one event

"""Artifact of `sync`: for every frame, the frame of the reference video it corresponds to."""

from __future__ import annotations

from math import nan
from typing import Annotated, ClassVar

from pydantic import Field, model_validator

from imocap_core.artifacts.schemas.base import Artifact, Floats, Floats32, Shape, Value, unique


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
        phases = [] if self.trust is None else [len(v.phase_s) for v in self.trust.videos]
        if self.trust is not None and phases != self.lengths:
            raise ValueError(f"trust: expected phases of lengths {self.lengths}, got {phases}")
        return self


class Sync(Artifact, SyncSummary):
    """Correspondences with the affinity they came from (Eq. 2); N frames of all videos together."""

    OPTIONAL: ClassVar[frozenset[str]] = frozenset({"sound_start_s"})

    affinity: Annotated[Floats32, Shape("N", "N")]
    relaxed: Annotated[Floats32, Shape("N", "N")]
    # when each video of one event began, by its sound, NaN where that does not tell; else None
    sound_start_s: Annotated[Floats, Shape("M")] | None = None

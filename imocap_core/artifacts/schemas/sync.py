"""What `sync` makes: for every frame, the frame of the reference video it corresponds to."""

from __future__ import annotations

from typing import Annotated

from pydantic import model_validator

from imocap_core.artifacts.schemas.base import Artifact, Floats, Floats32, Shape, Value, unique


class SyncMap(Value):
    """One video against the reference (the reference itself has the identity)."""

    id: str
    reference_frame: Annotated[Floats, Shape("T")]  # index into the reference's used frames, or NaN
    confidence: Annotated[Floats, Shape("T")]  # 0 to 1


class SyncSummary(Value):
    """Correspondences without the matrices they were read from."""

    reference: str
    ids: list[str]
    lengths: list[int]  # used frames of each video
    maps: list[SyncMap]
    method: str
    centrality: Annotated[Floats, Shape("M")]  # one a video; the reference has the largest
    status: str

    @model_validator(mode="after")
    def _belongs_together(self) -> SyncSummary:
        unique(self.ids)
        if self.reference not in self.ids:
            raise ValueError(f"reference {self.reference!r} is none of the videos {self.ids}")
        if [m.id for m in self.maps] != self.ids:
            raise ValueError(f"maps are of {[m.id for m in self.maps]}, expected {self.ids}")
        found = [len(m.reference_frame) for m in self.maps]
        if found != self.lengths:
            raise ValueError(f"maps have lengths {found}, expected {self.lengths}")
        return self


class Sync(Artifact, SyncSummary):
    """Correspondences with the affinity they came from (Eq. 2); N frames of all videos together."""

    affinity: Annotated[Floats32, Shape("N", "N")]
    relaxed: Annotated[Floats32, Shape("N", "N")]

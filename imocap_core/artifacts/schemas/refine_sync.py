"""Artifact of `refine_sync`: every round of sync and motion, and the best one."""

from __future__ import annotations

from imocap_core.artifacts.schemas.base import Artifact, Value
from imocap_core.artifacts.schemas.motion import SmplBa
from imocap_core.artifacts.schemas.sync import Sync, SyncSummary


class Round(Value):
    """One alternation of synchronisation and joint solve."""

    sync: SyncSummary
    motion: SmplBa
    cost: float
    sync_change_frames: float  # mean movement of the correspondences since the round before


class RefineSync(Artifact):
    """The alternation's history and its result."""

    rounds: list[Round]
    best: int  # index into rounds
    sync: Sync  # of the best round, or from its motion where the loop settled
    motion: SmplBa
    status: str

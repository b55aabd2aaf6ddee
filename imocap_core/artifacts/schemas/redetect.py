"""Artifact of `redetect`: limb joints that were looked for again, and where they are."""

from __future__ import annotations

from typing import Annotated

from imocap_core.artifacts.schemas.base import Artifact, Floats, Ints, Shape, Value
from imocap_core.identifiers import Id


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

"""Artifact of `hands`: fingers and wrists, where the keypoints have any."""

from __future__ import annotations

from typing import Annotated

from imocap_core.artifacts.schemas.base import Artifact, Floats, Ints, Shape, Value
from imocap_core.identifiers import Id


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

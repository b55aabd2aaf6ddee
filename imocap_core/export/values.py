"""An action's result as every exported format takes it: performances in one world."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from imocap_core.artifacts.schemas import SyncSummary, VideoKeypoints
from imocap_core.camera.world import BodyMotion, Extrinsics

Array = NDArray[np.float64]
Time = Literal["own", "common"]

CAMERA_UP = "-y"  # the world is the reference camera, whose y points down


@dataclass(frozen=True, eq=False)
class HandTrack:
    """Hands of one video, left and right: wrists (T, 2, 3) and fingers (T, 2, 15, 3) axis-angle,
    points (T, 2, 21, 3) metres, seen (T, 2)."""

    wrists: Array
    fingers: Array
    points: Array
    seen: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Performance:
    """One video's result, body and camera in the world; hands' rotations are local.

    body: see `BodyMotion`, 24 joints. turns (T, 3, 3): camera's first frame from frame, all the
    identity when it stands still; zoom (T,): focal length over the first frame's. frames, inside,
    phase_s: as in `formats.take.MotionClip`.
    """

    seen: VideoKeypoints
    fps: float
    body: BodyMotion
    betas: Array
    hands: HandTrack | None
    K: Array
    pose: Extrinsics
    turns: Array
    zoom: Array
    frames: Array
    inside: NDArray[np.bool_]
    phase_s: Array

    @property
    def id(self) -> str:
        """The video."""
        return self.seen.id


@dataclass(frozen=True, eq=False)
class Result:
    """All videos of an action, in the order of action.yaml."""

    action: str
    performances: list[Performance]
    reference: str
    model: str
    model_digest: str
    up_axis: str  # y or z: levelled, the ground at 0; -y: the reference camera's axes
    sync: SyncSummary
    time: Time = "own"
    left_out: tuple[str, ...] = ()  # videos without a place on the common axis
    folder: Path | None = None  # of the action, which its videos are relative to

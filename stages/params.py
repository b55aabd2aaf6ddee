"""Every parameter of every stage: its type and its bounds. No default: pipeline.yaml has them.

A stage's owner adds a field here and its value in pipeline.yaml, with the unit in the name.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Count = Annotated[int, Field(ge=1)]
NonNegative = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
Share = Annotated[float, Field(ge=0, le=1)]


class Group(BaseModel):
    """A group of parameters: immutable, complete, nothing unknown."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class KeypointsParams(Group):
    min_confidence: Share  # detections below it count as missing


class CameraMotionParams(Group):
    max_features: Count
    min_inliers: Count
    reprojection_threshold_px: Positive


class InitialSmplParams(Group):
    max_iterations: Count


class SyncParams(Group):
    method: Literal["als", "svt", "softmap", "none", "auto"]  # cycle consistency


class MotionParams(Group):
    solver: Literal["gauss_newton", "adam"]
    rank: Count  # s of Eq. 4 and 5
    max_iterations: Count


class RefineParams(Group):
    max_rounds: Annotated[int, Field(ge=0)]


class EvaluateParams(Group):
    figures: bool


class Params(Group):
    """All groups; a stage sees those that pipeline.yaml lists for it."""

    keypoints: KeypointsParams
    camera_motion: CameraMotionParams
    initial_smpl: InitialSmplParams
    sync: SyncParams
    motion: MotionParams
    refine: RefineParams
    evaluate: EvaluateParams

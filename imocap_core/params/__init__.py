"""Every parameter, each in one place: its type and bounds, default, unit, and what it does.

A group is a frozen dataclass that the core takes as it is. `Params()` has all defaults. Values
from pipeline.yaml, action.yaml and `--set` are validated by `imocap_core.pipeline.graph`;
docs/parameters.md is made from these classes.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from imocap_core.params.motion_params import (
    EvaluateParams,
    FitParams,
    InitialSmplParams,
    MotionParams,
    RefineParams,
    UncertaintyParams,
)
from imocap_core.params.sync_params import SyncParams
from imocap_core.params.video_params import (
    CameraMotionParams,
    CollectParams,
    DetectParams,
    KeypointsParams,
    RedetectParams,
)


@dataclass(frozen=True, kw_only=True)
class Params:
    """All groups, in the order in which a run needs them."""

    detect: DetectParams = field(default_factory=DetectParams)
    keypoints: KeypointsParams = field(default_factory=KeypointsParams)
    camera_motion: CameraMotionParams = field(default_factory=CameraMotionParams)
    initial_smpl: InitialSmplParams = field(default_factory=InitialSmplParams)
    fit: FitParams = field(default_factory=FitParams)
    sync: SyncParams = field(default_factory=SyncParams)
    collect: CollectParams = field(default_factory=CollectParams)
    motion: MotionParams = field(default_factory=MotionParams)
    redetect: RedetectParams = field(default_factory=RedetectParams)
    refine: RefineParams = field(default_factory=RefineParams)
    uncertainty: UncertaintyParams = field(default_factory=UncertaintyParams)
    evaluate: EvaluateParams = field(default_factory=EvaluateParams)


__all__ = [
    "CameraMotionParams",
    "CollectParams",
    "DetectParams",
    "EvaluateParams",
    "FitParams",
    "InitialSmplParams",
    "KeypointsParams",
    "MotionParams",
    "Params",
    "RedetectParams",
    "RefineParams",
    "SyncParams",
    "UncertaintyParams",
]

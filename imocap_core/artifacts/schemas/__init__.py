"""What each artifact contains, one file a stage; `base` checks arrays when a value is made."""

from imocap_core.artifacts.schemas.base import Artifact, Floats, Floats32, Ints, Shape, Value
from imocap_core.artifacts.schemas.camera_motion import (
    CameraMotion,
    LensDistortion,
    VideoCameraMotion,
)
from imocap_core.artifacts.schemas.evaluate import Evaluate, Table
from imocap_core.artifacts.schemas.hands import Hands, VideoHands
from imocap_core.artifacts.schemas.keypoints import (
    CorrectedMarks,
    HandKeypoints,
    Keypoints,
    LeftOutVideo,
    SourceMoments,
    VideoKeypoints,
)
from imocap_core.artifacts.schemas.motion import (
    AlternativeMotion,
    Camera,
    CommonMotion,
    GroundPlane,
    InitialSmpl,
    PathUnit,
    SmplBa,
    StartFit,
    SwappedSides,
    VideoMotion,
)
from imocap_core.artifacts.schemas.redetect import Redetect, RedetectedVideo
from imocap_core.artifacts.schemas.refine_sync import EventCamera, EventCameras, RefineSync, Round
from imocap_core.artifacts.schemas.sync import (
    AffinityBlock,
    CycleTriple,
    SoftMapBands,
    Sync,
    SyncMap,
    SyncSummary,
    SyncTrust,
    VideoTrust,
)
from imocap_core.artifacts.schemas.uncertainty import (
    NearPair,
    PredictedVideo,
    Uncertainty,
    VideoUncertainty,
    Viewpoint,
    WeakSpan,
)

__all__ = [
    "AffinityBlock",
    "AlternativeMotion",
    "Artifact",
    "Camera",
    "CameraMotion",
    "CommonMotion",
    "CorrectedMarks",
    "CycleTriple",
    "Evaluate",
    "EventCamera",
    "EventCameras",
    "Floats",
    "Floats32",
    "GroundPlane",
    "HandKeypoints",
    "Hands",
    "InitialSmpl",
    "Ints",
    "Keypoints",
    "LeftOutVideo",
    "LensDistortion",
    "NearPair",
    "PathUnit",
    "PredictedVideo",
    "Redetect",
    "RedetectedVideo",
    "RefineSync",
    "Round",
    "Shape",
    "SmplBa",
    "SoftMapBands",
    "SourceMoments",
    "StartFit",
    "SwappedSides",
    "Sync",
    "SyncMap",
    "SyncSummary",
    "SyncTrust",
    "Table",
    "Uncertainty",
    "Value",
    "VideoCameraMotion",
    "VideoHands",
    "VideoKeypoints",
    "VideoMotion",
    "VideoTrust",
    "VideoUncertainty",
    "Viewpoint",
    "WeakSpan",
]

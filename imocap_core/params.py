"""Every parameter of every stage: its type and its bounds. No default: pipeline.yaml has them.

A stage's owner adds a field here and its value in pipeline.yaml, with the unit in the name.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator

from imocap_core.conventions import SMPL_JOINTS

Count = Annotated[int, Field(ge=1)]
NonNegative = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
Share = Annotated[float, Field(ge=0, le=1)]


class Group(BaseModel):
    """A group of parameters: immutable, complete, nothing unknown."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class DetectParams(Group):
    detector: Literal["mediapipe", "rtmlib"]
    hands: bool  # fingers too
    world_landmarks: bool  # MediaPipe's 3D starts the fits, where the action names nothing else
    follow: bool  # MediaPipe: look near the last place only: faster, but it loses people
    min_detection_confidence: Share  # MediaPipe: below it there is nobody
    min_tracking_confidence: Share  # MediaPipe, following: below it the person is looked for anew
    rtmlib_mode: Literal["lightweight", "balanced", "performance"]  # which models it downloads
    rtmlib_person_model: str | None  # ONNX files of one's own, relative to the action's folder
    rtmlib_pose_model: str | None


class KeypointsParams(Group):
    min_confidence: Share  # detections below it count as missing
    max_gap_s: Positive  # a person unseen for longer begins a new track
    looks: bool  # people are told apart by their clothes too, where there are pictures
    performer: Literal["agreement", "score"]  # who performs, where a video shows several people
    sides: Literal["auto", "leave", "repair"]  # limbs whose left and right a detector exchanged
    cuts: bool  # look for cuts between shots, where there are pictures


class CameraMotionParams(Group):
    working_size_px: Count  # pictures are made smaller until their larger side is this
    max_features: Count
    min_inliers: Count
    reprojection_threshold_px: Positive  # pixels of the smaller pictures
    assumed_focal_factor: Positive  # focal length / larger side, where nothing tells it


class InitialSmplParams(Group):
    library_poses: Count  # poses drawn from the prior that 2D keypoints are matched against
    library_directions: Count  # sides from which each is seen
    candidates: Count  # kept a frame
    stride_s: Positive  # time between matched frames
    match_sigma: Positive  # keypoint misfit, share of the keypoints' spread
    step_m_s: Positive  # joint speed that costs 1 on the path
    starts: Count  # different starts that are fitted; the best is kept
    lifter: Literal["auto", "never"]  # whether it starts the fits where no estimate is named
    max_steps: Count


class SyncParams(Group):
    affinity: Literal["reciprocal", "gaussian"]  # the paper's map of distances, or a sharper one
    velocity_weight_s: NonNegative  # 1 m/s counts as much as this many metres; 0 = poses alone
    joint_weights: dict[str, NonNegative]  # by SMPL's joint names; 1 where none is given
    method: Literal["als", "svt", "softmap", "none", "auto"]  # cycle consistency
    rounds: Count  # compositions of softmap
    warp: Literal["posterior", "dtw"]  # mean over all monotone warps, or the paper's one path
    consensus_rounds: Annotated[int, Field(ge=0)]  # refinements against the other videos
    orientation_window_s: Positive  # an estimate's orientation error changes over about this long
    evidence_per_s: Positive  # independent looks at the pose per second of video; less = smoother
    unmatched_level: Positive  # how unlike poses may be before a match ends
    regularity: Share  # of warps whose rate changes slowly among those averaged
    rate_spread: Positive  # standard deviation of the logarithm of a rate
    rate_persistence_s: Positive  # how long a rate lasts
    positions_per_frame: Count  # positions tried between two reference frames
    max_rate: Positive  # most seconds of the reference per second of another video
    confidence_reach_s: Positive  # confidence = P(match within this much of the reference)
    least_difference_m: NonNegative  # pose distance below which poses are not told apart
    normalise_scale: bool  # divide each video by its body size
    outliers: Literal["exclude", "report", "ignore"]  # a video that shows another action
    mirrored: Literal["flip", "report", "ignore"]  # a left-handed flip of picture or performer

    @field_validator("joint_weights")
    @classmethod
    def _of_known_joints(cls, given: dict[str, float]) -> dict[str, float]:
        if unknown := sorted(set(given) - set(SMPL_JOINTS)):
            raise ValueError(f"expected joints of {', '.join(SMPL_JOINTS)}, got {unknown[0]}")
        if sum(given.get(name, 1.0) > 0 for name in SMPL_JOINTS) < 3:
            raise ValueError("expected at least three joints of weight above 0")
        return given


class RepetitionParams(Group):
    least_score: Share  # share of a clip that one repetition explains; below it nothing repeats
    least_quality: Share  # an occurrence that explains less of its poses is none
    match_level: Positive  # share of the way from a pose's nearest one to an unrelated one
    shortest_s: Positive


class FitParams(Group):
    focal_spread: NonNegative  # of the logarithm of an assumed focal length; 0: taken as it is
    noise_share: Positive  # keypoint noise (one standard deviation), share of the person's size
    noise_share_of: dict[str, Positive]  # by layout, of detectors that err otherwise
    robust_scale_sigma: Positive  # Geman-McClure scale in standard deviations
    pose_prior: NonNegative
    shape_prior: NonNegative
    limits: NonNegative
    velocity: NonNegative  # lambda_t of Eq. 7, relative to the speeds of real motion
    acceleration: NonNegative  # relative to the accelerations of real motion
    acceleration_scale: Positive  # of cost: larger accelerations cost the logarithm
    foot_speed_m_s: Positive  # speed of any foot that costs 1
    foot_hold_m_s: Positive  # speed of a foot that stands in the common motion that costs 1
    foot_scale: Positive  # square root of the most that a foot's speed costs
    path_velocity_m_s: Positive  # root speed that costs 1
    path_acceleration_m_s2: Positive
    evidence_mm: Positive  # standard deviation of a monocular estimator's 3D joints


class MotionParams(Group):
    objective: Literal["shared", "paper", "single"]
    rank: Count  # s of Eq. 4 and 5
    rounds: Count  # alternations of Eq. 8 (objective paper)
    coupling_rad: Positive  # difference of a joint between videos that costs 1 (lambda_r1)
    coupling_path_m: Positive  # difference of the root path that costs 1 (lambda_r2)
    agreement_rad: Positive  # a joint further from the other videos stops following them
    correlation_s: NonNegative  # deviations of a performance are counted once per this time
    max_steps: Count


class RefineParams(Group):
    max_rounds: Annotated[int, Field(ge=0)]
    settled_frames: NonNegative  # mean movement of the correspondences that ends the loop
    evidence: Literal["poses", "pictures"]  # what the loop synchronises by in the end


class UncertaintyParams(Group):
    correlation_s: Positive  # detector errors and deviations count once per this time
    pose_persistence_s: Positive  # the pose prior counts once per this time
    weak_limit: Positive  # times the action's median that a joint's deviation is reported above
    near_limit_deg: Positive  # two videos whose views differ by less are named


class HandsParams(Group):
    noise_share: Positive  # keypoint noise (one standard deviation), share of the hand's length
    robust_scale_sigma: Positive  # Geman-McClure scale in standard deviations
    min_confidence: Share  # keypoints below it are not used
    min_points: Count  # a hand with fewer keypoints counts as unseen
    wrist_rad: Positive  # spread of a hand's turn about the body's
    offset_m: Positive  # spread of a wrist's place about the body's
    pose_prior: NonNegative  # of the spread of everyday poses
    limit_rad: Positive  # transgression of a joint's range that costs 1
    coupling_rad: Positive  # difference from the common hands that costs 1
    agreement_rad: Positive  # a finger or wrist further from them stops following
    acceleration_rad_s2: Positive  # of wrists and fingers, one standard deviation
    offset_acceleration_m_s2: Positive
    size_spread: Positive  # of the logarithm of the hands' size, for the performer's shape
    stride_s: Positive  # between the frames in which many turns of the wrist are tried
    max_steps: Count


class EvaluateParams(Group):
    figures: bool


class Params(Group):
    """All groups; a stage sees those that pipeline.yaml lists for it."""

    detect: DetectParams
    keypoints: KeypointsParams
    camera_motion: CameraMotionParams
    initial_smpl: InitialSmplParams
    fit: FitParams
    sync: SyncParams
    repetitions: RepetitionParams
    motion: MotionParams
    refine: RefineParams
    uncertainty: UncertaintyParams
    hands: HandsParams
    evaluate: EvaluateParams

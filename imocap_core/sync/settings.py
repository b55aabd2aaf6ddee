"""Every choice of the synchronisation in one value."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """Every choice of the synchronisation; the values and their reasons are in pipeline.yaml and
    docs."""

    affinity: str  # reciprocal (the paper's) | gaussian
    velocity_weight_s: float  # 1 m/s counts as much as this many metres; 0 = poses alone
    method: str  # cycle consistency: softmap | als | svt | none | auto
    rounds: int  # compositions of softmap
    warp: str  # posterior (mean over all monotone warps) | dtw (the paper's)
    consensus_rounds: int  # refinements against the other videos' template; 0 = none
    orientation_window_s: float  # an estimate's orientation error changes over about this long
    evidence_per_s: float  # independent looks at the pose per second of video; less = smoother
    unmatched_level: float  # posterior: unmatched beyond 1 + 2 x this times the usual square;
    # dtw: beyond this share of the way from matching to unrelated
    regularity: float  # share of warps of slowly changing rate among those averaged, pairwise maps
    rate_spread: float  # standard deviation of the logarithm of a rate
    rate_persistence_s: float  # how long a rate lasts
    positions_per_frame: int  # positions tried between two reference frames
    max_rate: float  # most seconds of reference per second of video; inf = any
    confidence_reach_s: float  # confidence = P(match within this many seconds of the reference)
    normalise_scale: bool  # divide each video by its body size
    least_difference_m: float  # pose distance below which performances are not told apart
    outliers: str  # a video of another action: exclude | report | ignore
    mirrored: str  # a mirrored video: flip | report | ignore

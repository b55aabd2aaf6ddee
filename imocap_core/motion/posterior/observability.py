"""What the videos leave open.

Ill-determined joints and phases, videos that see the performer from nearly the same side, and the
viewpoint that would help most.
"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from imocap_core.motion.multiview.consensus import Cameras, align
from imocap_core.motion.multiview.scene import Scene
from imocap_core.motion.observations import own_view
from imocap_core.motion.posterior.azimuth import stage_of
from imocap_core.motion.posterior.uncertainty import Uncertainty
from imocap_core.motion.posterior.viewpoints import reductions, spec_alone, spec_of
from imocap_core.motion.state import MotionState
from imocap_core.params import MotionParams

Array = NDArray[np.float64]
ACROSS_DEG = 30.0  # a video this far off a line of sight tells depth along it
LEAST_SPAN_S = 0.2  # shorter ones are not reported
GAP_S = 0.2  # spans of one joint closer than this are one


@dataclass(frozen=True)
class Span:
    """Frames ``first`` to ``last`` (both within) in which a joint is ill-determined."""

    joint: int
    first: int
    last: int
    sigma: float  # root mean square over the span


@dataclass(frozen=True)
class Pair:
    """Two videos and the angle between their directions to the performer."""

    a: int
    b: int
    angle_deg: float


@dataclass(frozen=True)
class Open:
    """The viewpoints of a result.

    Attributes:
        azimuths_deg: (M,) where each camera stands about the performer, as a rule.
        pairs: videos that see the performer alike; across: whether another looks across theirs.
        reductions: (8,) share of the common motion's summed joint variance that one more camera
            at each of `viewpoints.AZIMUTHS_DEG` would take away.
        by_performer: False when azimuths count from the first camera (`azimuth.Stage`).
    """

    azimuths_deg: Array
    pairs: list[Pair]
    across: list[bool]
    reductions: Array
    by_performer: bool


def observe(
    scene: Scene,
    state: MotionState,
    cameras: Cameras,
    found: Uncertainty,
    options: MotionParams,
    *,
    near_limit_deg: float,
    evidence_share: float,
) -> Open:
    """The viewpoints of a result: its motions (batch of M), cameras and posterior."""
    directions = view_directions(scene, state, cameras)
    mean = _mean(directions)
    ground = stage_of(scene.body, found.motion, cameras.R.cpu().numpy(), mean[scene.reference])
    angles = angles_deg(directions)
    pairs = near_pairs(angles, near_limit_deg)
    weights = scene.weights
    if found.common is None:
        own = own_view(scene.observations, state.trans)
        spec = spec_alone(state, own, options)
    else:
        spec = spec_of(found.common)
    gain = reductions(
        scene.body, found.motion, found.normal, ground, spec,
        scale=weights.robust_scale_sigma, share=evidence_share,
    )  # fmt: skip
    return Open(
        np.array([ground.azimuth_deg(direction) for direction in mean]),
        pairs,
        [seen_across(angles, pair.a, pair.b, ACROSS_DEG) for pair in pairs],
        gain,
        ground.by_performer,
    )


def weak_spans(sigma: Array, limit: float, fps: float) -> list[Span]:
    """Where standard deviations (T, J) exceed ``limit``, worst first; NaN counts as known."""
    spans = []
    for joint, column in enumerate(sigma.T):
        for first, last in _runs(np.nan_to_num(column) > limit, max(1, round(GAP_S * fps))):
            if last - first + 1 >= LEAST_SPAN_S * fps:
                inside = column[first : last + 1]
                spans.append(Span(joint, first, last, float(np.sqrt(np.nanmean(inside**2)))))
    return sorted(spans, key=lambda s: -s.sigma)


def _runs(flags: NDArray[np.bool_], gap: int) -> list[tuple[int, int]]:
    """First and last index of each run of True; runs closer than ``gap`` are one."""
    at = np.flatnonzero(flags)
    if not len(at):
        return []
    cuts = np.flatnonzero(np.diff(at) > gap)
    begins, ends = at[np.r_[0, cuts + 1]], at[np.r_[cuts, len(at) - 1]]
    return [(int(a), int(b)) for a, b in zip(begins, ends, strict=True)]


def view_directions(scene: Scene, state: MotionState, cameras: Cameras) -> Array:
    """(M, N, 3) unit vectors from each camera to its performer, world axes; NaN where unmatched."""
    aligned = align(scene.body, state, scene.timeline)
    ray = torch.nn.functional.normalize(aligned.pelvis, dim=-1)
    world = torch.einsum("mji,mnj->mni", cameras.R, ray)
    unmatched = (aligned.weight <= 0)[..., None]
    directions: Array = torch.where(unmatched, torch.nan, world).cpu().numpy()
    return directions


def _mean(directions: Array) -> Array:
    """(M, 3) over the frames that are known; NaN for a video without any."""
    known = np.isfinite(directions).all(-1, keepdims=True)
    count = known.sum(1)
    total = np.where(known, directions, 0.0).sum(1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def angles_deg(directions: Array) -> Array:
    """(M, M) median angle between two videos' directions over the frames that both have; NaN
    where there are none."""
    cosine = np.einsum("anx,bnx->abn", directions, directions).clip(-1, 1)
    angles = np.full(cosine.shape[:2], np.nan)
    for a, b in np.ndindex(*angles.shape):
        both = np.isfinite(cosine[a, b])
        if both.any():
            angles[a, b] = np.degrees(np.median(np.arccos(cosine[a, b, both])))
    return angles


def near_pairs(angles: Array, limit_deg: float) -> list[Pair]:
    """Videos that see the performer from nearly the same side, nearest first."""
    pairs = [
        Pair(a, b, float(angles[a, b]))
        for a in range(len(angles))
        for b in range(a + 1, len(angles))
        if angles[a, b] < limit_deg
    ]
    return sorted(pairs, key=lambda pair: pair.angle_deg)


def seen_across(angles: Array, a: int, b: int, limit_deg: float) -> bool:
    """Whether some video looks across the line of sight that ``a`` and ``b`` share."""
    off_axis = np.minimum(angles[a], 180 - angles[a])
    off_axis[[a, b]] = 0.0
    return bool(np.nanmax(off_axis) > limit_deg)

"""What the videos leave open.

Ill-determined joints and phases, near-identical viewpoints, and the viewpoint that would help most.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from imocap_core.motion.multiview.aligned import align
from imocap_core.motion.multiview.scene import JointMotion, Scene
from imocap_core.motion.observations import per_video_view
from imocap_core.motion.posterior.azimuth import performer_axes
from imocap_core.motion.posterior.motion_posterior import MotionPosterior
from imocap_core.motion.posterior.viewpoints import camera_for_single, camera_like, reductions
from imocap_core.motion.solver.objective import linearise
from imocap_core.params import MotionParams
from imocap_core.runs import runs

ACROSS_DEG = 30.0  # a video this far off a line of sight determines depth along it
LEAST_SPAN_S = 0.2  # shorter ones are not reported
GAP_S = 0.2  # spans of one joint closer than this are one


@dataclass(frozen=True)
class WeakInterval:
    """Frames ``first`` to ``last`` (both within) in which a joint is ill-determined."""

    joint: int
    first: int
    last: int
    sigma: float  # root mean square over the span


@dataclass(frozen=True)
class NearViews:
    """Two videos and the angle between their directions to the performer."""

    a: int
    b: int
    angle_deg: float


@dataclass(frozen=True)
class ViewpointReport:
    """The viewpoints of a result.

    Attributes:
        azimuths_deg: (M,) mean azimuth of each camera about the performer.
        pairs: near-identical views; across: whether another video looks across theirs.
        reductions: (8,) share of the common motion's summed joint variance that one more camera
            at each of `viewpoints.AZIMUTHS_DEG` would take away.
        by_performer: False when azimuths count from the first camera (`azimuth.PerformerAxes`).
    """

    azimuths_deg: Float[np.ndarray, " M"]
    pairs: list[NearViews]
    across: list[bool]
    reductions: Float[np.ndarray, "8"]
    by_performer: bool


def viewpoint_report(
    scene: Scene,
    result: JointMotion,
    posterior: MotionPosterior,
    options: MotionParams,
    *,
    near_limit_deg: float,
    evidence_share: float,
) -> ViewpointReport:
    """The viewpoints of a result and its posterior; evidence_share: see `Noise`."""
    cameras = result.cameras
    directions = view_directions(scene, result)
    mean = _mean(directions)
    ground = performer_axes(
        scene.body, posterior.motion, cameras.R.cpu().numpy(), mean[scene.reference]
    )
    angles = angles_deg(directions)
    pairs = near_pairs(angles, near_limit_deg)
    if posterior.common is None:
        view = per_video_view(scene.observations, result.state.trans)
        camera = camera_for_single(result.state, view, options)
    else:
        camera = camera_like(posterior.common)
    gain = reductions(
        scene.body, posterior.motion, linearise(posterior.terms, posterior.motion), ground, camera,
        scale=scene.fit.robust_scale_sigma, share=evidence_share,
    )  # fmt: skip
    return ViewpointReport(
        np.array([ground.azimuth_deg(direction) for direction in mean]),
        pairs,
        [seen_across(angles, pair.a, pair.b, ACROSS_DEG) for pair in pairs],
        gain,
        ground.by_performer,
    )


def weak_spans(sigma: Float[np.ndarray, "T J"], limit: float, fps: float) -> list[WeakInterval]:
    """Where standard deviations exceed ``limit``, worst first; NaN counts as 0."""
    spans = []
    for joint, column in enumerate(sigma.T):
        weak = np.nan_to_num(column) > limit
        gap = max(1, round(GAP_S * fps)) - 1
        for first, last in runs(weak, math.ceil(LEAST_SPAN_S * fps), gap):
            inside = column[first : last + 1]
            spans.append(WeakInterval(joint, first, last, float(np.sqrt(np.nanmean(inside**2)))))
    return sorted(spans, key=lambda s: -s.sigma)


def view_directions(scene: Scene, result: JointMotion) -> Float[np.ndarray, "M N 3"]:
    """Unit vectors from each camera to its performer, world axes; NaN where unmatched."""
    aligned = align(scene.body, result.state, scene.timeline)
    ray = torch.nn.functional.normalize(aligned.root, dim=-1)
    world = torch.einsum("mji,mnj->mni", result.cameras.R, ray)
    unmatched = (aligned.weight <= 0)[..., None]
    return torch.where(unmatched, torch.nan, world).cpu().numpy()


def _mean(directions: np.ndarray) -> np.ndarray:
    """(M, 3) over the frames that are matched; NaN for a video without any."""
    matched = np.isfinite(directions).all(-1, keepdims=True)
    count = matched.sum(1)
    total = np.where(matched, directions, 0.0).sum(1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def angles_deg(directions: Float[np.ndarray, "M N 3"]) -> Float[np.ndarray, "M M"]:
    """Median angle between two videos' directions over the frames that both have; NaN if none."""
    cosine = np.einsum("anx,bnx->abn", directions, directions).clip(-1, 1)
    angles = np.full(cosine.shape[:2], np.nan)
    for a, b in np.ndindex(*angles.shape):
        both = np.isfinite(cosine[a, b])
        if both.any():
            angles[a, b] = np.degrees(np.median(np.arccos(cosine[a, b, both])))
    return angles


def near_pairs(angles: Float[np.ndarray, "M M"], limit_deg: float) -> list[NearViews]:
    """Videos that see the performer from nearly the same side, nearest first."""
    pairs = [
        NearViews(a, b, float(angles[a, b]))
        for a in range(len(angles))
        for b in range(a + 1, len(angles))
        if angles[a, b] < limit_deg
    ]
    return sorted(pairs, key=lambda pair: pair.angle_deg)


def seen_across(angles: Float[np.ndarray, "M M"], a: int, b: int, limit_deg: float) -> bool:
    """Whether some video looks across the line of sight that ``a`` and ``b`` share."""
    off_axis = np.minimum(angles[a], 180 - angles[a])
    off_axis[[a, b]] = 0.0
    return bool(np.nanmax(off_axis) > limit_deg)

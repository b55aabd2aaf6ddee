"""Between artifacts and the core's posterior."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imocap_core.artifacts.schemas import (
    Keypoints,
    NearPair,
    RefineSync,
    Uncertainty,
    VideoMotion,
    VideoUncertainty,
    Viewpoint,
    WeakSpan,
)
from imocap_core.conventions import EVAL_14, SMPL_JOINTS
from imocap_core.metrics.calibration import along_and_across, total_sigma
from imocap_core.motion.posterior.observability import Open, weak_spans
from imocap_core.motion.posterior.viewpoints import AZIMUTHS_DEG
from imocap_core.params import UncertaintyParams
from imocap_core.problem.mirroring import REFLECTION, TWINS, JointWork

Array = NDArray[np.float64]
NAMED = [SMPL_JOINTS.index(name) for name in EVAL_14]  # hands, toes and collars are hardly seen


@dataclass(frozen=True)
class Claims:
    """What the core says of a group, as it was solved (mirrored videos reflected)."""

    work: JointWork
    covariances_m2: list[Array]
    left_open: Open


def uncertainty_of(
    claims: Sequence[Claims], keypoints: Keypoints, refined: RefineSync, told: UncertaintyParams
) -> Uncertainty:
    """The artifact: what the groups say, as filmed, and where that is much."""
    motions = {v.id: v for v in refined.motion.videos}
    found: dict[str, VideoUncertainty] = {}
    for k, claim in enumerate(claims):
        for v, seen in enumerate(claim.work.keypoints.videos):
            C = claim.covariances_m2[v]
            if seen.id in claim.work.mirrored:
                C = C[:, TWINS] * REFLECTION[:, None] * REFLECTION
            azimuth = float(claim.left_open.azimuths_deg[v]) if k == 0 else float("nan")
            found[seen.id] = _video(motions[seen.id], 1e6 * C, azimuth)
    videos = [found[v.id] for v in keypoints.videos]
    every = np.concatenate([v.sigma_mm[:, NAMED].ravel() for v in videos])
    unknown = [v.id for v in videos if not np.isfinite(v.sigma_mm).all()]
    median = float(np.nanmedian(every)) if np.isfinite(every).any() else float("nan")
    weak = [
        span
        for video, seen in zip(videos, keypoints.videos, strict=True)
        for span in _weak(video, seen.fps, told.weak_limit, median)
    ]
    whole, ids = claims[0].left_open, [v.id for v in claims[0].work.keypoints.videos]
    return Uncertainty(
        videos=videos,
        median_mm=median,
        weak=sorted(weak, key=lambda span: -span.sigma_mm),
        near=[
            NearPair(videos=[ids[p.a], ids[p.b]], angle_deg=p.angle_deg, seen_across=across)
            for p, across in zip(whole.pairs, whole.across, strict=True)
        ],
        near_limit_deg=told.near_limit_deg,
        weak_limit=told.weak_limit,
        viewpoints=[
            Viewpoint(azimuth_deg=a, reduction=float(r))
            for a, r in zip(AZIMUTHS_DEG, whole.reductions, strict=True)
            if np.isfinite(r)
        ],
        azimuth_from="performer" if whole.by_performer else "camera",
        status=_status(median, unknown),
    )


def _video(motion: VideoMotion, covariance_mm2: Array, azimuth_deg: float) -> VideoUncertainty:
    root = motion.joints[:, 0]
    sight = root / np.linalg.norm(root, axis=-1, keepdims=True)
    depth, across = along_and_across(covariance_mm2, sight[:, None])
    return VideoUncertainty(
        id=motion.id,
        frames=motion.frames,
        sigma_mm=total_sigma(covariance_mm2),
        depth_mm=depth,
        across_mm=across,
        covariance_mm2=covariance_mm2.astype(np.float32),
        azimuth_deg=azimuth_deg,
    )


def _weak(video: VideoUncertainty, fps: float, limit: float, median: float) -> list[WeakSpan]:
    spans = weak_spans(video.sigma_mm[:, NAMED], limit * median, fps)
    return [
        WeakSpan(
            video=video.id,
            joint=EVAL_14[span.joint],
            first_frame=int(video.frames[span.first]),
            last_frame=int(video.frames[span.last]),
            begin_s=float(video.frames[span.first] / fps),
            end_s=float(video.frames[span.last] / fps),
            sigma_mm=span.sigma,
            of_median=span.sigma / median,
        )
        for span in spans
    ]


def _status(median: float, unknown: list[str]) -> str:
    said = f"Half of all standard deviations (14 joints, all frames) are below {median:.0f} mm"
    if unknown:
        said += f"; unknown for {', '.join(unknown)}, whose normal matrix is not positive definite"
    return said + "."

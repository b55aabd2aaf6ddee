"""Every video's keypoints at the reference's frames: what the common motion is fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.multiview.scene import Cameras, root_positions
from imocap_core.motion.multiview.timeline import Timeline, sample_keypoints, values_at
from imocap_core.motion.observations import Observation
from imocap_core.motion.state import Body, MotionState
from imocap_core.motion.terms import JointEvidence, Reprojection, Term, View
from imocap_core.motion.terms.view import project

ESTIMATE_SIGMAS = 3.0  # Geman-McClure scale, in standard deviations of an estimator


@dataclass(frozen=True)
class CommonKeypoints:
    """Keypoints of M videos at the N frames of the reference.

    Attributes:
        xy_px: (M, N, K, 2); weight: (M, N, K) 1/px^2, 0 where missing; sigma_px: (M, N) noise.
        offset_sd: (M, 6) standard deviations of each performance's per-frame rigid offset from the
            common motion (three rotations, rad, and three translations, m), or None: rigid copies.
        performers: of each video, the number of the person shown.
        centre_m: (M, N, 3) places of the cameras, each in its first frame's axes, or None: none
            of them moves.
        place_sd_m: (M, N) standard deviations of the performers' places that come of the cameras'
            uncertain paths, or None.
    """

    xy_px: Float[np.ndarray, "M N K 2"]
    weight: Float[np.ndarray, "M N K"]
    sigma_px: Float[np.ndarray, "M N"]
    offset_sd: Float[np.ndarray, "M 6"] | None = None
    performers: tuple[int, ...] = ()
    centre_m: Float[np.ndarray, "M N 3"] | None = None
    place_sd_m: Float[np.ndarray, "M N"] | None = None

    def moves(self, video: int) -> bool:
        """Whether the path of a video's camera is known."""
        return self.centre_m is not None and bool(np.any(self.centre_m[video]))


def common_keypoints(observations: Sequence[Observation], timeline: Timeline) -> CommonKeypoints:
    """Sample all keypoints at the reference's frames, sub-frame."""
    xy, weight, sigma = [], [], []
    rows = zip(observations, timeline.from_reference, timeline.confidence, strict=True)
    for o, position, trust in rows:
        value, confidence = sample_keypoints(o.xy_px, o.confidence, position)
        nearest = np.clip(np.nan_to_num(position).round().astype(int), 0, len(o.xy_px) - 1)
        noise = o.sigma_px[nearest]
        xy.append(value)
        weight.append(confidence * trust[:, None] / noise[:, None] ** 2)
        sigma.append(noise)
    return CommonKeypoints(
        np.stack(xy), np.stack(weight), np.stack(sigma),
        performers=tuple(o.performer for o in observations),
        centre_m=_sampled([o.centre_m for o in observations], timeline, 3),
        place_sd_m=_sampled([o.place_sd_m for o in observations], timeline),
    )  # fmt: skip


def _sampled(
    values: Sequence[Float[np.ndarray, "_ ..."] | None], timeline: Timeline, *shape: int
) -> Float[np.ndarray, "M N ..."] | None:
    """Values of every video at the reference's frames, 0 where a video has none; None where no
    video has any."""
    if all(of_video is None for of_video in values):
        return None
    sampled = []
    for of_video, position in zip(values, timeline.from_reference, strict=True):
        if of_video is None:
            sampled.append(np.zeros((len(position), *shape)))
            continue
        frame = np.clip(np.nan_to_num(position), 0, len(of_video) - 1)
        sampled.append(values_at(of_video, frame))
    return np.stack(sampled)


def common_estimates(
    body: Body,
    observations: Sequence[Observation],
    timeline: Timeline,
    template: Tensor,
    *,
    evidence_mm: float,
) -> list[Term]:
    """Every estimator's joints (24) at the reference's frames, as evidence of articulation.

    Args:
        template: gives dtype and device; evidence_mm: standard deviation of an estimated joint.
    """
    joints, weights = [], []
    rows = zip(observations, timeline.from_reference, timeline.confidence, strict=True)
    for o, position, trust in rows:
        if o.joints is None:
            continue
        finite = np.isfinite(o.joints).all(-1)
        sampled, given = sample_keypoints(o.joints, finite.astype(float), position)
        joints.append(sampled)
        weights.append(given * trust[:, None] / (evidence_mm / 1000) ** 2)
    if not joints:
        return []
    estimates, strength = (
        torch.as_tensor(np.stack(x, 1)).to(template)[None] for x in (joints, weights)
    )
    return [JointEvidence(body, estimates, strength, ESTIMATE_SIGMAS)]


def views_of(
    keypoints: CommonKeypoints,
    cameras: Cameras,
    template: Tensor,
    *,
    free: Sequence[int],
    free_focal: Sequence[int] = (),
) -> tuple[View, ...]:
    """One view a video.

    Args:
        template: gives dtype and device.
        free: videos whose cameras are unknowns of the state; free_focal: whose focal lengths are;
            in that order.
    """
    views = []
    for v in range(len(keypoints.xy_px)):
        arrays = (keypoints.xy_px[v], keypoints.weight[v], cameras.K[v])
        xy, weight, K = (torch.as_tensor(a).to(template)[None] for a in arrays)
        focal = list(free_focal).index(v) if v in free_focal else None
        camera = list(free).index(v) if v in free else None
        precision = None
        if keypoints.offset_sd is not None:
            precision = offset_precision(keypoints, v, template)
        R, t = cameras.R[v][None], cameras.t[v][None]
        performer = keypoints.performers[v] if keypoints.performers else 0
        places = keypoints.centre_m
        centre = None if places is None else torch.as_tensor(places[v]).to(template)[None]
        views.append(View(xy, weight, K, R, t, camera, focal, precision, performer, centre))
    return tuple(views)


def offset_precision(
    keypoints: CommonKeypoints, video: int, template: Tensor
) -> Float[Tensor, "1 N 6"]:
    """Inverse variances of a performance's rigid offset; its translation is also as uncertain as
    the camera's path."""
    assert keypoints.offset_sd is not None
    sharp = torch.as_tensor(keypoints.offset_sd[video] ** -2.0).to(template)
    precision = sharp.expand(1, keypoints.xy_px.shape[1], -1)
    if keypoints.place_sd_m is None:
        return precision
    place = torch.as_tensor(keypoints.place_sd_m[video]).to(template)[None, :, None]
    variance = 1 / precision
    return 1 / torch.cat([variance[..., :3], variance[..., 3:] + place.square()], -1)


def reprojection_errors_px(
    body: Body,
    motion: MotionState,
    keypoints: CommonKeypoints,
    cameras: Cameras,
    *,
    robust_scale: float,
) -> Float[np.ndarray, "M N K 2"]:
    """Signed errors of the common motion, rigid offsets taken out; NaN where missing."""
    term = Reprojection(body, views_of(keypoints, cameras, motion.trans, free=()), robust_scale)
    errors = []
    for view in term.views:
        xyz, _ = term.offset_points(view, motion)
        pixels, _ = project(view, xyz)
        error = torch.where(view.weight[..., None] > 0, pixels - view.xy_px, torch.nan)
        errors.append(error[0].cpu().numpy())
    return np.stack(errors)


def root_depths_m(
    body: Body, motion: MotionState, cameras: Cameras, keypoints: CommonKeypoints
) -> Float[np.ndarray, "M N"]:
    """Depth of the common motion's root in every view, metres."""
    root = root_positions(body, motion)[0]
    z = torch.einsum("mj,nj->mn", cameras.R[:, 2], root) + cameras.t[:, None, 2]
    if keypoints.centre_m is not None:
        z = z - torch.as_tensor(keypoints.centre_m[..., 2]).to(z)
    return z.clamp_min(0.1).cpu().numpy()

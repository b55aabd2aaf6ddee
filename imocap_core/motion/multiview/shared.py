"""One motion on the reference's axis, seen by every video at once.

Averaging monocular fits keeps their depth errors; fitting one motion to all views' 2D removes
them. This is bundle adjustment proper: poses, shape and cameras are unknowns of one system.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from imocap_core.camera.pnp import pnp_over_frames
from imocap_core.motion.kinematics import Body
from imocap_core.motion.multiview.consensus import Cameras, pelvis
from imocap_core.motion.multiview.focal_lengths import NO_LENSES, Lenses
from imocap_core.motion.multiview.scene import solve
from imocap_core.motion.multiview.timeline import Timeline, sample_keypoints
from imocap_core.motion.observations import Observation
from imocap_core.motion.solver.gauss_newton import Solution
from imocap_core.motion.solver.objective import HALVES
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms import JointEvidence, Reprojection, Term, View
from imocap_core.motion.terms.view import project
from imocap_core.params import MotionParams

Array = NDArray[np.float64]
EVIDENCE_SCALE = 3.0  # Geman-McClure, in standard deviations of an estimator


@dataclass(frozen=True)
class Evidence:
    """Every video's keypoints at the reference's frames.

    Attributes:
        xy_px: (M, N, K, 2); weight: (M, N, K) in 1/px^2, 0 where unseen; sigma_px: (M, N).
        stray: (M, 6) standard deviations with which each performance turns (rad) and shifts (m)
            as a whole against the common one, or None: rigid copies.
    """

    xy_px: Array
    weight: Array
    sigma_px: Array
    stray: Array | None = None


def gather(observations: Sequence[Observation], timeline: Timeline) -> Evidence:
    """Sample all keypoints at the reference's frames, sub-frame."""
    xy, weight, sigma = [], [], []
    for o, at, trust in zip(
        observations, timeline.from_reference, timeline.confidence, strict=True
    ):
        value, confidence = sample_keypoints(o.xy_px, o.confidence, at)
        nearest = np.clip(np.nan_to_num(at).round().astype(int), 0, len(o.xy_px) - 1)
        noise = o.sigma_px[nearest]
        xy.append(value)
        weight.append(confidence * trust[:, None] / noise[:, None] ** 2)
        sigma.append(noise)
    return Evidence(np.stack(xy), np.stack(weight), np.stack(sigma))


def estimates_on_axis(
    body: Body,
    observations: Sequence[Observation],
    timeline: Timeline,
    like: Tensor,
    *,
    evidence_mm: float,
) -> list[Term]:
    """Every estimator's joints (24) at the reference's frames, as evidence of articulation."""
    joints, weights = [], []
    for o, at, trust in zip(
        observations, timeline.from_reference, timeline.confidence, strict=True
    ):
        if o.joints is None:
            continue
        known = np.isfinite(o.joints).all(-1)
        sampled, given = sample_keypoints(o.joints, known.astype(float), at)
        joints.append(sampled)
        weights.append(given * trust[:, None] / (evidence_mm / 1000) ** 2)
    if not joints:
        return []
    on_axis, strength = (torch.as_tensor(np.stack(x, 1)).to(like)[None] for x in (joints, weights))
    return [JointEvidence(body, on_axis, strength, EVIDENCE_SCALE)]


def views_of(
    evidence: Evidence,
    cameras: Cameras,
    like: Tensor,
    *,
    free: Sequence[int],
    lenses: Sequence[int] = (),
) -> tuple[View, ...]:
    """One view a video; the cameras in ``free`` and the focal lengths in ``lenses`` become unknowns
    of the state, in that order."""
    views = []
    for v in range(len(evidence.xy_px)):
        arrays = (evidence.xy_px[v], evidence.weight[v], cameras.K[v])
        xy, weight, K = (torch.as_tensor(a).to(like)[None] for a in arrays)
        focal = list(lenses).index(v) if v in lenses else None
        camera = list(free).index(v) if v in free else None
        stray = None
        if evidence.stray is not None:
            sharp = torch.as_tensor(evidence.stray[v] ** -2.0).to(like)
            stray = sharp.expand(1, xy.shape[1], -1)
        R, t = cameras.R[v][None], cameras.t[v][None]
        views.append(View(xy, weight, K, R, t, camera, focal, stray))
    return tuple(views)


def refine_by_pnp(
    body: Body,
    state: MotionState,
    evidence: Evidence,
    cameras: Cameras,
    reference: int,
    *,
    robust_scale: float,
) -> Cameras:
    """Each camera from the shared motion's 3D keypoints over all frames (PnP, "Optimization").

    A camera whose PnP fails or does not lower the reprojection error keeps its place.
    """
    xyz = body.positions(body.keypoints, state).xyz[0].cpu().numpy()
    R, t = cameras.R.clone(), cameras.t.clone()
    for v in range(len(R)):
        if v == reference or not (evidence.weight[v] > 0).any():
            continue
        sigma = float(np.median(evidence.sigma_px[v]))
        found = pnp_over_frames(
            xyz,
            evidence.xy_px[v],
            evidence.weight[v] * sigma**2,
            cameras.K[v].cpu().numpy(),
            R[v].cpu().numpy(),
            scale_px=robust_scale * sigma,
            inlier_px=2 * robust_scale * sigma,
        )
        if found.ok:
            R[v], t[v] = torch.as_tensor(found.R).to(R), torch.as_tensor(found.t).to(t)
    return replace(cameras, R=R, t=t)


def shared_problem(
    body: Body,
    start: MotionState,
    evidence: Evidence,
    cameras: Cameras,
    free: Sequence[int],
    *,
    robust_scale: float,
    lenses: Lenses = NO_LENSES,
) -> tuple[list[Term], MotionState]:
    """What all views say of one motion, as two halves of them that can be worked on at the same
    time, and the start with the cameras in ``free`` and the focal lengths of ``lenses`` among its
    unknowns."""
    index = torch.tensor(free, dtype=torch.long, device=start.trans.device)
    state = replace(
        start,
        camera_R=cameras.R[index][None],
        camera_t=cameras.t[index][None],
        log_focal=start.trans.new_zeros(1, len(lenses.videos)),
    )
    views = views_of(evidence, cameras, start.trans, free=free, lenses=lenses.videos)
    halves = [views[k::HALVES] for k in range(min(HALVES, len(views)))]
    image = [Reprojection(body, half, robust_scale) for half in halves]
    return [*image, *lenses.prior(cameras.K)], state


def fit_shared(
    body: Body,
    start: MotionState,
    evidence: Evidence,
    cameras: Cameras,
    free: Sequence[int],
    terms: Sequence[Term],
    options: MotionParams,
    *,
    robust_scale: float,
    lenses: Lenses = NO_LENSES,
) -> tuple[MotionState, Cameras, Solution]:
    """Joint Gauss-Newton over the shared motion, its shape, the cameras in ``free`` and the focal
    lengths of ``lenses``.

    Args:
        start: one motion (batch of 1) in the world's axes on the reference's frames.
        terms: regularisers.

    Returns:
        The motion, the cameras, and the solver's account.
    """
    free = [v for v in free if (evidence.weight[v] > 0).any()]
    image, state = shared_problem(
        body, start, evidence, cameras, free, robust_scale=robust_scale, lenses=lenses
    )
    solution = solve([*image, *terms], state, options, one_body=False)
    state = solution.state
    R, t = cameras.R.clone(), cameras.t.clone()
    index = torch.tensor(free, dtype=torch.long, device=start.trans.device)
    R[index], t[index] = state.camera_R[0], state.camera_t[0]
    K = lenses.found(cameras.K, state.log_focal[0])
    motion = MotionState.of(state.R_local, state.trans, state.betas, state.valid)
    return motion, Cameras(R, t, K), solution


def reprojection_errors_px(
    body: Body, state: MotionState, evidence: Evidence, cameras: Cameras, *, robust_scale: float
) -> Array:
    """(M, N, K, 2) signed error of the shared motion, strays taken out, NaN where unseen."""
    term = Reprojection(body, views_of(evidence, cameras, state.trans, free=()), robust_scale)
    errors = []
    for view in term.views:
        at, _ = term.placed(view, state)
        pixels, _ = project(view, at)
        error = torch.where(view.weight[..., None] > 0, pixels - view.xy_px, torch.nan)
        errors.append(error[0].cpu().numpy())
    return np.stack(errors)


def depths_m(body: Body, state: MotionState, cameras: Cameras) -> Array:
    """(M, N) depth of the root in every view, metres."""
    root = pelvis(body, state)[0]
    z = torch.einsum("mj,nj->mn", cameras.R[:, 2], root) + cameras.t[:, None, 2]
    depth: Array = z.clamp_min(0.1).cpu().numpy()
    return depth

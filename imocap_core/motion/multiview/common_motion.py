"""The motion common to all videos, fitted to every view's 2D at once: bundle adjustment proper.

Averaging monocular fits keeps their depth errors; fitting one motion to all views' 2D removes
them. Poses, shape, cameras and unknown focal lengths are unknowns of one system. In between, how
far each performance deviates is estimated anew, and its keypoints count accordingly.

A focal length shows in how a body's near and far parts differ in size, and in how its size changes
along a path that the other videos see from elsewhere. Performances that differ throughout change
both, so against the prior the focal likelihood counts once per action. They tilt cameras and bodies
too: `terms.body_priors.LevelCameras` keeps cameras near the up of each video alone, and keypoints
that are elsewhere throughout (`modes.lasting_m`) count less from the start.

A performance's per-frame rigid offset (`terms.view`) has six standard deviations a video, by
expectation maximisation: given these, every frame's offset has a posterior; given the posteriors,
the variance is their mean square. What reprojection errors have beyond that and detector noise is
the spread of single keypoints. It is observed in the image plane; in depth the same is assumed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.gauss_newton import HALVES, Solution, gauss_newton
from imocap_core.motion.monocular.fit import ESTIMATE_SIGMAS, Progress
from imocap_core.motion.multiview.modes import lasting_m, mode_shifts, spread_beyond_noise_m
from imocap_core.motion.multiview.scene import (
    TOLERANCE,
    Cameras,
    CommonKeypoints,
    DeviationSpread,
    Scene,
    consensus_motion,
    correlation_frames,
    root_positions,
    starts_by_video,
)
from imocap_core.motion.multiview.timeline import sample_keypoints
from imocap_core.motion.state import Body, MotionState
from imocap_core.motion.terms import FocalPrior, JointEvidence, Reprojection, ScorePrior, Term, View
from imocap_core.motion.terms.body_priors import LevelCameras
from imocap_core.motion.terms.view import project, with_focal
from imocap_core.params import MotionParams
from imocap_core.robust import geman_mcclure
from imocap_core.sync.warp.template import OFFSET_FLOOR, OFFSET_START
from imocap_core.workers import serial_map, thread_map


@dataclass(frozen=True)
class Unknowns:
    """What is solved for with the common motion and its shape, in the order of the state's.

    Attributes:
        cameras: videos whose cameras are unknowns; videos: F of them, whose focal lengths are.
        assumed_px: (F,) the prior's means; weight: (F,) of the squared error of a logarithm.
        ups: (M, 3) of all videos, each in its camera's axes; up_per_sd: (M,) 1 / rad, or 0.
    """

    cameras: Sequence[int] = ()
    videos: Sequence[int] = ()
    assumed_px: Float[Tensor, " F"] = field(default_factory=lambda: torch.zeros(0))
    weight: Float[Tensor, " F"] = field(default_factory=lambda: torch.zeros(0))
    ups: Float[Tensor, "M 3"] | None = None
    up_per_sd: Float[Tensor, " M"] = field(default_factory=lambda: torch.zeros(0))

    def prior(self, K: Float[Tensor, "M 3 3"]) -> list[FocalPrior]:
        """The prior of the focal lengths as a term about views with intrinsics K."""
        if not self.videos:
            return []
        now = K[list(self.videos), 0, 0]
        return [FocalPrior((self.assumed_px.to(now) / now).log(), self.weight.to(now))]

    def intrinsics(
        self, K: Float[Tensor, "M 3 3"], log_focal: Float[Tensor, " F"]
    ) -> Float[Tensor, "M 3 3"]:
        """K with the focal lengths of a state."""
        K, free = K.clone(), list(self.videos)
        K[free] = with_focal(K[free], log_focal.exp())
        return K


NO_UNKNOWNS = Unknowns()


def unknowns_of(scene: Scene, cameras: Sequence[int]) -> Unknowns:
    """Some videos' cameras, and the focal lengths that are unknown."""
    videos = [v for v, o in enumerate(scene.observations) if o.focal_spread > 0]
    spread = torch.tensor([scene.observations[v].focal_spread for v in videos])
    frames = len(scene.timeline.from_reference[scene.reference])
    alone = [o.up or (np.zeros(3), np.inf) for o in scene.observations]
    ups, sd_deg = (torch.as_tensor(np.array(x)) for x in zip(*alone, strict=True))
    assumed, per_sd = scene.K[videos, 0, 0], 1 / torch.deg2rad(sd_deg)
    return Unknowns(cameras, videos, assumed, frames / spread**2, ups, per_sd)


@dataclass(frozen=True)
class CommonViews:
    """Every video's view of the common motion: its keypoints at the reference's frames, its camera.

    Attributes:
        robust_scale: of the reprojection errors, in standard deviations.
    """

    body: Body
    keypoints: CommonKeypoints
    cameras: Cameras
    robust_scale: float


def views_of(
    keypoints: CommonKeypoints, cameras: Cameras, template: Tensor, unknowns: Unknowns = NO_UNKNOWNS
) -> tuple[View, ...]:
    """One view a video; template: gives dtype and device."""
    free, free_focal = list(unknowns.cameras), list(unknowns.videos)
    views, shifts = [], None
    if keypoints.shifts_m is not None:
        shifts = torch.as_tensor(keypoints.shifts_m).to(template).permute(1, 2, 3, 0)[None]
    for v in range(len(keypoints.xy_px)):
        arrays = (keypoints.xy_px[v], keypoints.weight[v], cameras.K[v])
        xy, weight, K = (torch.as_tensor(a).to(template)[None] for a in arrays)
        focal = free_focal.index(v) if v in free_focal else None
        camera = free.index(v) if v in free else None
        precision = None
        if keypoints.offset_sd is not None:
            precision = offset_precision(keypoints, v, template)
        R, t = cameras.R[v][None], cameras.t[v][None]
        performer = keypoints.performers[v] if keypoints.performers else 0
        places = keypoints.centre_m
        centre = None if places is None else torch.as_tensor(places[v]).to(template)[None]
        view = View(xy, weight, K, R, t, camera, focal, precision, performer, centre)
        views.append(replace(view, shifts=shifts, performance=v))
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


def image_term(views: CommonViews, motion: MotionState) -> Reprojection:
    """All views' reprojection of a common motion (batch of 1, world axes), nothing else unknown."""
    seen_by = views_of(views.keypoints, views.cameras, motion.trans)
    return Reprojection(views.body, seen_by, views.robust_scale)


def reprojection_errors_px(views: CommonViews, motion: MotionState) -> Float[np.ndarray, "M N K 2"]:
    """Signed errors of the common motion, rigid offsets taken out; NaN where missing."""
    term = image_term(views, motion)
    errors = []
    for view in term.views:
        xyz, _ = term.offset_points(view, motion)
        pixels, _ = project(view, xyz)
        error = torch.where(view.weight[..., None] > 0, pixels - view.xy_px, torch.nan)
        errors.append(error[0].cpu().numpy())
    return np.stack(errors)


def root_depths_m(views: CommonViews, motion: MotionState) -> Float[np.ndarray, "M N"]:
    """Depth of the common motion's root in every view, metres."""
    root, cameras = root_positions(views.body, motion)[0], views.cameras
    z = torch.einsum("mj,nj->mn", cameras.R[:, 2], root) + cameras.t[:, None, 2]
    if views.keypoints.centre_m is not None:
        z = z - torch.as_tensor(views.keypoints.centre_m[..., 2]).to(z)
    return z.clamp_min(0.1).cpu().numpy()


ROUNDS = 6
MIN_KEYPOINTS = 4  # fewer do not determine a rigid offset


def with_initial_offsets(scene: Scene) -> CommonKeypoints:
    """A scene's keypoints, every performance with a rigid offset of generous spread."""
    first = np.tile(OFFSET_START, (len(scene.observations), 1))
    return replace(scene.keypoints, offset_sd=first)


def estimate_offset_sd(views: CommonViews, motion: MotionState) -> CommonViews:
    """Offset spreads estimated from the views' keypoints; one without keypoints keeps its own.

    Args:
        motion: the common one (batch of 1, world axes).
    """
    keypoints = views.keypoints
    if keypoints.offset_sd is None:
        return views
    term = image_term(views, motion)
    pairs = list(zip(term.views, keypoints.offset_sd, strict=True))
    each = serial_map if motion.trans.is_cuda else thread_map
    spread = each(lambda pair: _offset_sd(term, pair[0], motion, pair[1]), pairs)
    return replace(views, keypoints=replace(keypoints, offset_sd=np.stack(spread)))


def _offset_sd(
    term: Reprojection, view: View, motion: MotionState, before: np.ndarray
) -> np.ndarray:
    usable = (view.weight > 0).sum(-1)[0] >= MIN_KEYPOINTS
    if not bool(usable.any()):
        return before
    sigma, offset = torch.as_tensor(before).to(motion.trans), None
    for _ in range(ROUNDS):
        precision = sigma.pow(-2).expand(1, len(usable), -1)
        offset, sharpness = term.rigid_offsets(view, motion, precision, offset)
        covariance = torch.linalg.inv(sharpness[0, usable])
        sigma = _mean_square(offset[0, usable], covariance).sqrt()
    return sigma.cpu().numpy()


def _mean_square(offset: Tensor, covariance: Tensor) -> Tensor:
    """(6,) one variance of the three rotations and one of the three translations."""
    square = offset.square() + covariance.diagonal(dim1=-2, dim2=-1)
    rotation = square[:, :3].mean().clamp_min(OFFSET_FLOOR[0] ** 2)
    translation = square[:, 3:].mean().clamp_min(OFFSET_FLOOR[3] ** 2)
    return torch.cat([rotation.expand(3), translation.expand(3)])


def keypoint_spread_m(
    views: CommonViews, motion: MotionState, fps: float
) -> Float[np.ndarray, "M N K"]:
    """Standard deviation per coordinate, metres, of each keypoint from the common motion."""
    errors, depth = reprojection_errors_px(views, motion), root_depths_m(views, motion)
    return spread_beyond_noise_m(
        errors, views.keypoints.sigma_px, depth, views.cameras.focal_px, window=round(fps / 2)
    )


def with_keypoint_spread(
    views: CommonViews, motion: MotionState, spread_m: Float[np.ndarray, "M N K"]
) -> CommonViews:
    """The views, the variance of their keypoints with the performances' deviations in it."""
    keypoints = views.keypoints
    focal_px = views.cameras.focal_px[:, None]
    spread_px = spread_m * (focal_px / root_depths_m(views, motion))[..., None]
    sigma2 = keypoints.sigma_px[..., None] ** 2
    weight = keypoints.weight * sigma2 / (sigma2 + spread_px**2)
    return replace(views, keypoints=replace(keypoints, weight=weight))


def estimate_terms(scene: Scene, template: Tensor, options: MotionParams) -> list[Term]:
    """Every estimator's joints (24) at the reference's frames, as evidence of articulation that is
    counted once per correlation time; template: gives dtype and device."""
    sd_m = scene.fit.evidence_mm * correlation_frames(options, scene.fps) ** 0.5 / 1000
    joints, weights = [], []
    timeline = scene.timeline
    rows = zip(scene.observations, timeline.from_reference, timeline.confidence, strict=True)
    for o, position, trust in rows:
        if o.joints is None:
            continue
        finite = np.isfinite(o.joints).all(-1)
        sampled, given = sample_keypoints(o.joints, finite.astype(float), position)
        joints.append(sampled)
        weights.append(given * trust[:, None] / sd_m**2)
    if not joints:
        return []
    estimates, strength = (
        torch.as_tensor(np.stack(x, 1)).to(template)[None] for x in (joints, weights)
    )
    return [JointEvidence(scene.body, estimates, strength, ESTIMATE_SIGMAS)]


ROBUST_STAGES = (3.0, 1.0, 1.0)  # of the robust scale, relative to the final one
# A second start is the motion fitted at this one: a limb on the wrong side feels the keypoints of
# the views that see it elsewhere. At the others those are outliers, and two opposite views agree
# with either side. Further starts have the arms, then the legs, of single videos: where all look
# along one line, depth stays as it began. The start that ends at the lowest objective is followed.
WIDE = 10.0
_LIMBS = ("collar", "shoulder", "elbow", "wrist"), ("hip", "knee", "ankle")
MISFIT_SIGMAS = 3.0  # Geman-McClure scale of the misfit, relative to the final robust scale


@dataclass(frozen=True)
class CommonFit:
    """The common motion (batch of 1, world axes), its cameras, and how the solver ended.

    Attributes:
        spread: how far each performance deviates.
        costs: the objective after each stage; misfit: as of `misfit`.
    """

    motion: MotionState
    cameras: Cameras
    spread: DeviationSpread
    costs: list[float]
    status: str
    misfit: float


def fit_in_stages(
    scene: Scene,
    state: MotionState,
    cameras: Cameras,
    options: MotionParams,
    progress: Progress,
    *,
    cameras_known: bool,
    restart: bool,
    with_modes: bool = False,
) -> CommonFit:
    """Common motion and cameras, the robust loss narrowing; deviations re-estimated in between.

    Args:
        state: every video's motion, whose consensus is the start; cameras: where they begin, or
            where they are and stay (``cameras_known``).
        restart: pass through the wide robust scales; else the start has done so before.
        with_modes: the state is an earlier solve's, which tells how performances differ.
    """
    start = consensus_motion(scene, state, cameras)
    shifts_m = mode_shifts(scene, state, cameras, start) if with_modes else None
    keypoints, unknowns = scene.keypoints, NO_UNKNOWNS
    if not cameras_known:
        unknowns = unknowns_of(scene, [v for v in range(len(cameras.R)) if v != scene.reference])
    if options.objective != "single":
        keypoints = with_initial_offsets(scene)
    if shifts_m is not None:
        keypoints = replace(keypoints, shifts_m=shifts_m)
        start = replace(start, scores=start.trans.new_zeros(1, len(cameras.R), len(shifts_m)))
    final = scene.fit.robust_scale_sigma
    views = CommonViews(scene.body, keypoints, cameras, final)
    terms = [*scene.regularisers, *estimate_terms(scene, start.trans, options)]
    motion, costs, status, steps = start, list[float](), "", options.max_steps
    spread_m, starts, aligned = np.zeros(keypoints.weight.shape), [start], scene.aligned(state)
    if not cameras_known:  # which would be tilted to explain what differs throughout
        errors, depth = reprojection_errors_px(views, start), root_depths_m(views, start)
        spread_m += lasting_m(errors, depth, cameras.focal_px)
    if restart:
        progress(f"common motion, robust scale {WIDE:g}x")
        wide = replace(views, robust_scale=final * WIDE)
        starts.append(fit_common_motion(wide, start, NO_UNKNOWNS, terms, steps)[0])
    for stage in ROBUST_STAGES if restart else ROBUST_STAGES[1:]:
        progress(f"common motion, robust scale {stage:g}x")
        views = replace(views, robust_scale=final * stage)
        weighted = with_keypoint_spread(views, motion, spread_m)
        fits = [fit_common_motion(weighted, begun, unknowns, terms, steps) for begun in starts]
        for limbs in _LIMBS if restart and stage == ROBUST_STAGES[0] else ():
            motion, cameras, _ = min(fits, key=_cost)
            turned = replace(weighted, cameras=cameras)
            others = starts_by_video(aligned, motion, limbs)
            fits += [fit_common_motion(turned, begun, unknowns, terms, steps) for begun in others]
        motion, cameras, solution = min(fits, key=_cost)
        starts = [motion]
        views = estimate_offset_sd(replace(views, cameras=cameras), motion)
        spread_m = keypoint_spread_m(replace(views, robust_scale=final), motion, scene.fps)
        costs.append(solution.costs[-1])
        status = solution.status
    of_each = None
    if shifts_m is not None:
        of_each = np.einsum("mk,knpx->mnpx", motion.scores[0].cpu().numpy(), shifts_m)
        spread_m = np.sqrt(spread_m**2 + np.square(of_each).mean(-1))
        motion = replace(motion, scores=motion.scores[:, :0])
    sd = views.keypoints.offset_sd
    spread = None if sd is None else DeviationSpread(spread_m, sd, of_each)
    spread = spread or estimate_spread(scene, motion, cameras)
    return CommonFit(motion, cameras, spread, costs, status, misfit(scene, motion, cameras, sd))


def _cost(fit: tuple[MotionState, Cameras, Solution]) -> float:
    return fit[2].costs[-1]


def estimate_spread(scene: Scene, motion: MotionState, cameras: Cameras) -> DeviationSpread:
    """How far performances deviate from a common motion that was not fitted with deviations."""
    keypoints = with_initial_offsets(scene)
    views = CommonViews(scene.body, keypoints, cameras, scene.fit.robust_scale_sigma)
    for _ in ROBUST_STAGES:  # as often as a fit does: expectation maximisation is slow
        views = estimate_offset_sd(views, motion)
    assert views.keypoints.offset_sd is not None
    return DeviationSpread(keypoint_spread_m(views, motion, scene.fps), views.keypoints.offset_sd)


def common_problem(
    views: CommonViews, start: MotionState, unknowns: Unknowns
) -> tuple[list[Term], MotionState]:
    """The terms of all views, in halves to be worked on at the same time, and the start with its
    unknown cameras and focal lengths."""
    cameras = views.cameras
    index = torch.tensor(unknowns.cameras, dtype=torch.long, device=start.trans.device)
    state = replace(
        start,
        camera_R=cameras.R[index][None],
        camera_t=cameras.t[index][None],
        log_focal=start.trans.new_zeros(1, len(unknowns.videos)),
    )
    all_ = views_of(views.keypoints, cameras, start.trans, unknowns)
    halves = [all_[k::HALVES] for k in range(min(HALVES, len(all_)))]
    image = [Reprojection(views.body, half, views.robust_scale) for half in halves]
    scores = [] if views.keypoints.shifts_m is None else [ScorePrior()]
    return [*image, *unknowns.prior(cameras.K), *_level(views, unknowns), *scores], state


def _level(views: CommonViews, unknowns: Unknowns) -> list[LevelCameras]:
    """The prior of level cameras, where at least two videos with keypoints tell up."""
    if unknowns.ups is None:
        return []
    R, weight, free = views.cameras.R, views.keypoints.weight, list(unknowns.cameras)
    shown = torch.as_tensor((weight > 0).any(axis=(1, 2))).to(R)
    ups, per_sd = unknowns.ups.to(R), unknowns.up_per_sd.to(R) * shown
    if int((per_sd > 0).sum()) < 2:
        return []
    common = LevelCameras.common((R.mT @ ups[..., None])[..., 0], per_sd)
    return [LevelCameras(common, ups[free], per_sd[free], weight.shape[1])]


def fit_common_motion(
    views: CommonViews,
    start: MotionState,
    unknowns: Unknowns,
    terms: Sequence[Term],
    max_steps: int,
) -> tuple[MotionState, Cameras, Solution]:
    """Joint Gauss-Newton over the common motion, its shape, cameras and unknown focal lengths.

    Args:
        start: one motion (batch of 1) in the world's axes at the reference's frames.
        terms: regularisers.

    Returns:
        The motion, the cameras, and how the solver ended.
    """
    weight, cameras = views.keypoints.weight, views.cameras
    free = [v for v in unknowns.cameras if (weight[v] > 0).any()]
    unknowns = replace(unknowns, cameras=free)
    image, state = common_problem(views, start, unknowns)
    solution = gauss_newton(
        [*image, *terms], state, max_steps=max_steps, relative_tolerance=TOLERANCE
    )
    state = solution.state
    R, t = cameras.R.clone(), cameras.t.clone()
    index = torch.tensor(free, dtype=torch.long, device=start.trans.device)
    R[index], t[index] = state.camera_R[0], state.camera_t[0]
    K = unknowns.intrinsics(cameras.K, state.log_focal[0])
    motion = MotionState.of(state.R_local, state.trans, state.betas, state.valid)
    motion = replace(motion, other_betas=state.other_betas, scores=state.scores)
    return motion, Cameras(R, t, K), solution


def misfit(
    scene: Scene,
    motion: MotionState,
    cameras: Cameras,
    offset_sd: Float[np.ndarray, "M 6"] | None = None,
) -> float:
    """Mean Geman-McClure reprojection cost of one motion for all videos, over the keypoints, each
    counted by the confidence in its frame's match: a match that is not trusted makes no fit good.
    """
    keypoints = replace(scene.keypoints, offset_sd=offset_sd)
    scale = scene.fit.robust_scale_sigma
    errors = reprojection_errors_px(CommonViews(scene.body, keypoints, cameras, scale), motion)
    trust = scene.timeline.confidence[..., None] * (keypoints.weight > 0)
    weight = np.divide(keypoints.weight, trust, out=np.zeros_like(trust), where=trust > 0)
    squared = weight * np.nan_to_num(errors**2).sum(-1)
    cost, _ = geman_mcclure(torch.as_tensor(squared), MISFIT_SIGMAS * scale)
    return float((torch.as_tensor(trust) * cost).sum()) / max(float(trust.sum()), 1e-9)

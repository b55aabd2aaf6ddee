"""The motion common to all videos, fitted to every view's 2D at once.

Unknown focal lengths, solved with the common motion as far as it determines them.

A focal length shows in how a body's near and far parts differ in size, and in how its size changes
along a path that the other videos see from elsewhere. Performances that differ change both for as
long as the action lasts, however many frames show it; so against the prior the focal likelihood
counts once per action. Where videos show one motion that is enough to find the focal length; where
they differ, or nothing moves much, the assumed value stays.

Averaging monocular fits keeps their depth errors; fitting one motion to all views' 2D removes
them. This is bundle adjustment proper: poses, shape, cameras and unknown focal lengths are unknowns
of one system.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.gauss_newton import HALVES, Solution
from imocap_core.motion.monocular.fit import Progress, regularisers
from imocap_core.motion.multiview.common_keypoints import (
    CommonKeypoints,
    common_estimates,
    common_keypoints,
    reprojection_errors_px,
    views_of,
)
from imocap_core.motion.multiview.per_video import (
    estimate_offset_sd,
    initial_offset_sd,
    keypoint_spread_m,
    with_keypoint_spread,
)
from imocap_core.motion.multiview.scene import (
    Cameras,
    DeviationSpread,
    Scene,
    correlation_frames,
    solve,
)
from imocap_core.motion.state import Body, MotionState
from imocap_core.motion.terms import FocalPrior, Reprojection, Term
from imocap_core.motion.terms.view import with_focal
from imocap_core.params import MotionParams
from imocap_core.robust import geman_mcclure


@dataclass(frozen=True)
class FreeFocalLengths:
    """Videos whose focal lengths are unknowns, with their prior.

    Attributes:
        videos: F indices, in the order of the state's focal lengths.
        assumed_px: (F,) the prior's means; weight: (F,) of the squared error of a logarithm.
    """

    videos: Sequence[int]
    assumed_px: Float[Tensor, " F"]
    weight: Float[Tensor, " F"]

    def prior(self, K: Float[Tensor, "M 3 3"]) -> list[FocalPrior]:
        """The prior as a term about views with intrinsics K."""
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


NO_FREE_FOCAL_LENGTHS = FreeFocalLengths((), torch.zeros(0), torch.zeros(0))


def free_focal_lengths(scene: Scene) -> FreeFocalLengths:
    """The unknown focal lengths of a scene's videos."""
    videos = [v for v, o in enumerate(scene.observations) if o.focal_spread > 0]
    spread = torch.tensor([scene.observations[v].focal_spread for v in videos])
    frames = len(scene.timeline.from_reference[scene.reference])
    return FreeFocalLengths(videos, scene.K[videos, 0, 0], frames / spread**2)


ROBUST_STAGES = (3.0, 1.0, 1.0)  # of the robust scale, relative to the final one
# A second start is the motion fitted at this one: a limb on the wrong side feels the keypoints of
# the views that see it elsewhere. At the others those are outliers, and two opposite views agree
# with either side. The start that ends at the lower objective is followed.
WIDE = 10.0
MISFIT_SIGMAS = 3.0  # Geman-McClure scale of the misfit, relative to the final robust scale


@dataclass(frozen=True)
class CommonFit:
    """The common motion (batch of 1, world axes), its cameras, and how the solver ended.

    Attributes:
        spread: how far each performance deviates; None: one motion for all.
        costs: the objective after each stage.
    """

    motion: MotionState
    cameras: Cameras
    spread: DeviationSpread | None
    costs: list[float]
    status: str


def fit_in_stages(
    scene: Scene,
    start: MotionState,
    cameras: Cameras,
    options: MotionParams,
    progress: Progress,
    *,
    cameras_known: bool,
    afresh: bool,
) -> CommonFit:
    """Common motion and cameras, the robust loss narrowing; deviations re-estimated in between.

    Args:
        start: one motion (batch of 1), world axes; cameras: where they begin, or where they are
            and stay (``cameras_known``).
        afresh: pass through the wide robust scales; else the start has done so before.
    """
    free = [] if cameras_known else [v for v in range(len(cameras.R)) if v != scene.reference]
    keypoints = common_keypoints(scene.observations, scene.timeline)
    if options.objective != "single":
        first = initial_offset_sd(len(scene.observations), options)
        keypoints = replace(keypoints, offset_sd=first)
    terms = [*regularisers(scene.body, scene.prior, scene.fit, scene.fps)]
    terms += estimate_terms(scene, start, options)
    focal = NO_FREE_FOCAL_LENGTHS if cameras_known else free_focal_lengths(scene)
    motion, costs, status = start, list[float](), ""
    spread_m, starts = np.zeros(keypoints.weight.shape), [start]
    if afresh:
        progress(f"one motion for all views, robust scale {WIDE:g}x")
        starts.append(_wide_fit(scene, start, keypoints, cameras, terms, options))
    for stage in ROBUST_STAGES if afresh else ROBUST_STAGES[1:]:
        progress(f"one motion for all views, robust scale {stage:g}x")
        scale = scene.fit.robust_scale_sigma * stage
        weighted = with_keypoint_spread(scene.body, keypoints, spread_m, motion, cameras)
        fits = [
            fit_common_motion(
                scene.body, begun, weighted, cameras, free, terms, options.max_steps,
                robust_scale=scale, focal=focal,
            )
            for begun in starts
        ]  # fmt: skip
        motion, cameras, solution = min(fits, key=lambda fit: fit[2].costs[-1])
        starts = [motion]
        keypoints = estimate_offset_sd(
            scene.body, motion, keypoints, cameras, options, robust_scale=scale
        )
        spread_m = keypoint_spread_m(scene, motion, keypoints, cameras)
        costs.append(solution.costs[-1])
        status = solution.status
    sd = keypoints.offset_sd
    spread = None if sd is None else DeviationSpread(spread_m, sd)
    return CommonFit(motion, cameras, spread, costs, status)


def _wide_fit(
    scene: Scene,
    start: MotionState,
    keypoints: CommonKeypoints,
    cameras: Cameras,
    terms: Sequence[Term],
    options: MotionParams,
) -> MotionState:
    """The motion alone, fitted under the widest robust loss."""
    scale = scene.fit.robust_scale_sigma * WIDE
    steps = options.max_steps
    return fit_common_motion(
        scene.body, start, keypoints, cameras, [], terms, steps, robust_scale=scale
    )[0]


def estimate_terms(scene: Scene, motion: MotionState, options: MotionParams) -> list[Term]:
    """Monocular estimates as evidence, counted once per correlation time."""
    sd_mm = scene.fit.evidence_mm * correlation_frames(options, scene.fps) ** 0.5
    return common_estimates(
        scene.body, scene.observations, scene.timeline, motion.trans, evidence_mm=sd_mm
    )


def estimate_spread(
    scene: Scene, motion: MotionState, cameras: Cameras, options: MotionParams
) -> DeviationSpread:
    """How far performances deviate from a common motion that was not fitted with deviations."""
    scale = scene.fit.robust_scale_sigma
    first = initial_offset_sd(len(scene.observations), options)
    keypoints = replace(common_keypoints(scene.observations, scene.timeline), offset_sd=first)
    for _ in ROBUST_STAGES:  # as often as a fit does: expectation maximisation is slow
        keypoints = estimate_offset_sd(
            scene.body, motion, keypoints, cameras, options, robust_scale=scale
        )
    assert keypoints.offset_sd is not None
    spread_m = keypoint_spread_m(scene, motion, keypoints, cameras)
    return DeviationSpread(spread_m, keypoints.offset_sd)


def common_problem(
    body: Body,
    start: MotionState,
    keypoints: CommonKeypoints,
    cameras: Cameras,
    free: Sequence[int],
    *,
    robust_scale: float,
    focal: FreeFocalLengths = NO_FREE_FOCAL_LENGTHS,
) -> tuple[list[Term], MotionState]:
    """The terms of all views, in two halves that can be worked on at the same time, and the start.

    The cameras in ``free`` and the focal lengths of ``focal`` are among the start's unknowns.
    """
    index = torch.tensor(free, dtype=torch.long, device=start.trans.device)
    state = replace(
        start,
        camera_R=cameras.R[index][None],
        camera_t=cameras.t[index][None],
        log_focal=start.trans.new_zeros(1, len(focal.videos)),
    )
    views = views_of(keypoints, cameras, start.trans, free=free, free_focal=focal.videos)
    halves = [views[k::HALVES] for k in range(min(HALVES, len(views)))]
    image = [Reprojection(body, half, robust_scale) for half in halves]
    return [*image, *focal.prior(cameras.K)], state


def fit_common_motion(
    body: Body,
    start: MotionState,
    keypoints: CommonKeypoints,
    cameras: Cameras,
    free: Sequence[int],
    terms: Sequence[Term],
    max_steps: int,
    *,
    robust_scale: float,
    focal: FreeFocalLengths = NO_FREE_FOCAL_LENGTHS,
) -> tuple[MotionState, Cameras, Solution]:
    """Joint Gauss-Newton over the common motion, its shape, cameras and unknown focal lengths.

    Args:
        start: one motion (batch of 1) in the world's axes at the reference's frames.
        free: videos whose cameras are unknowns; terms: regularisers.

    Returns:
        The motion, the cameras, and how the solver ended.
    """
    free = [v for v in free if (keypoints.weight[v] > 0).any()]
    image, state = common_problem(
        body, start, keypoints, cameras, free, robust_scale=robust_scale, focal=focal
    )
    solution = solve([*image, *terms], state, max_steps)
    state = solution.state
    R, t = cameras.R.clone(), cameras.t.clone()
    index = torch.tensor(free, dtype=torch.long, device=start.trans.device)
    R[index], t[index] = state.camera_R[0], state.camera_t[0]
    K = focal.intrinsics(cameras.K, state.log_focal[0])
    motion = MotionState.of(state.R_local, state.trans, state.betas, state.valid)
    return replace(motion, other_betas=state.other_betas), Cameras(R, t, K), solution


def misfit(
    scene: Scene,
    motion: MotionState,
    cameras: Cameras,
    offset_sd: Float[np.ndarray, "M 6"] | None = None,
) -> float:
    """Mean Geman-McClure reprojection cost of one motion for all videos, over the keypoints, each
    counted by the confidence in its frame's match: a match that is not trusted makes no fit good.
    """
    keypoints = common_keypoints(scene.observations, scene.timeline)
    keypoints = replace(keypoints, offset_sd=offset_sd)
    scale = scene.fit.robust_scale_sigma
    errors = reprojection_errors_px(scene.body, motion, keypoints, cameras, robust_scale=scale)
    trust = scene.timeline.confidence[..., None] * (keypoints.weight > 0)
    weight = np.divide(keypoints.weight, trust, out=np.zeros_like(trust), where=trust > 0)
    squared = weight * np.nan_to_num(errors**2).sum(-1)
    cost, _ = geman_mcclure(torch.as_tensor(squared), MISFIT_SIGMAS * scale)
    return float((torch.as_tensor(trust) * cost).sum()) / max(float(trust.sum()), 1e-9)

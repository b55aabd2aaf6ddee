"""SMPL-BA: the motion of every video and all cameras, jointly (Eq. 8).

Two ways behind one parameter. ``paper`` alternates as the paper does: Z and Y by SVD, poses and
paths by the solver, cameras by PnP. ``shared`` (default) starts from one such round, then fits
ONE motion to all views' 2D at once and gives each video back as much freedom as its own image
evidence asks for. ``single`` stops before that last step: one motion for all videos.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Int

from imocap_core.motion.monocular.fit import Progress
from imocap_core.motion.multiview.aligned import align
from imocap_core.motion.multiview.beyond_reference import continued, within_reference
from imocap_core.motion.multiview.cameras import Cameras, cameras_from_motion
from imocap_core.motion.multiview.common_motion import estimate_spread, fit_in_stages, misfit
from imocap_core.motion.multiview.consensus import consensus_motion, mean_shapes
from imocap_core.motion.multiview.low_rank_round import low_rank_round
from imocap_core.motion.multiview.one_performance import follow_common
from imocap_core.motion.multiview.per_video import fit_deviations
from imocap_core.motion.multiview.relocalisation import relocalise
from imocap_core.motion.multiview.scene import JointMotion, Scene
from imocap_core.motion.multiview.swapped_sides import with_sides_of_others
from imocap_core.motion.state import MotionState
from imocap_core.params import MotionParams

START_STEPS = 2  # of the coupled fit that the common one starts from: more gain nothing there


def recover_motion(
    scene: Scene,
    start: MotionState,
    options: MotionParams,
    progress: Progress = lambda _: None,
    *,
    cameras: Cameras | None = None,
    swapped: Sequence[Int[np.ndarray, " _"]] = (),
    afresh: bool = False,
) -> JointMotion:
    """SMPL-BA from motions in their own camera axes (batch of M) and correspondences.

    Args:
        cameras: of an earlier result that ``start`` is part of: it needs no coupling before the
            common fit (``paper`` alternates all the same).
        swapped: which sides of the detections that result had swapped, of every video; where others
            are now, all is fitted afresh.
        afresh: fit through all robust scales all the same, and every deviation from the common
            motion, instead of going on where the earlier result stopped.
    """
    if len(scene.observations) == 1:
        return _single_video(scene, start)
    if options.objective != "shared" or not scene.beyond:
        return _recovered(scene, start, options, progress, cameras, swapped, afresh)
    scene, axis = continued(scene)
    result = _recovered(scene, start, options, progress, cameras, swapped, afresh)
    return within_reference(result, axis)


def _recovered(
    scene: Scene,
    start: MotionState,
    options: MotionParams,
    progress: Progress,
    cameras: Cameras | None,
    swapped: Sequence[Int[np.ndarray, " _"]],
    afresh: bool,
) -> JointMotion:
    """The same of two videos or more, on the scene's own axis."""
    state = shared_shapes(start, scene.performers)
    if cameras is not None and options.objective != "paper":
        scene = with_sides_of_others(scene, state, cameras)
        afresh |= any((a != b).any() for a, b in zip(swapped, scene.swapped, strict=False))
        return common_then_deviations(scene, state, cameras, options, progress, afresh=afresh)
    aligned = align(scene.body, state, scene.timeline)
    cameras = cameras_from_motion(aligned, scene.K.to(start.trans), scene.reference)
    if options.objective == "paper":
        return _alternate(scene, state, cameras, options, progress)
    progress("coupled fit 1 of 1")  # only a start for the common fit
    few = replace(options, max_steps=min(START_STEPS, options.max_steps))
    state, cameras, cost = low_rank_round(scene, state, cameras, few, pnp=False)
    state, cameras = relocalise(scene, state, cameras, options.agreement_rad)
    scene = with_sides_of_others(scene, state, cameras)
    result = common_then_deviations(scene, state, cameras, options, progress)
    return replace(result, costs=[cost, *result.costs])


def common_then_deviations(
    scene: Scene,
    state: MotionState,
    cameras: Cameras,
    options: MotionParams,
    progress: Progress = lambda _: None,
    *,
    cameras_known: bool = False,
    afresh: bool = True,
) -> JointMotion:
    """One motion for all views, then each video's deviation from it.

    Args:
        state: every video's motion in its own camera's axes, one body a performer.
        cameras: where they start, or where they are and stay (``cameras_known``).
        afresh: begin at the widest robust scale; else state and cameras are an earlier result of
            this function, and it goes on where that stopped.
    """
    start = consensus_motion(scene, state, cameras, options.agreement_rad)
    common = fit_in_stages(
        scene, start, cameras, options, progress, cameras_known=cameras_known, afresh=afresh
    )
    motion, cameras = common.motion, common.cameras
    if common.spread is None:
        fit = misfit(scene, motion, cameras)
        status = f"one motion for all: {common.status}"
        spread = estimate_spread(scene, motion, cameras, options)
        state = follow_common(scene.with_intrinsics(cameras), state, motion, cameras, options)
        motion = motion.uncached()
        return JointMotion(state, cameras, motion, spread, common.costs, status, fit, scene.swapped)
    fit = misfit(scene, motion, cameras, common.spread.offset_sd)
    progress("each video's own deviation")
    solved = scene.with_intrinsics(cameras)
    state, cost = fit_deviations(
        solved, state, motion, cameras, common.spread, options, afresh=afresh
    )
    costs, status = [*common.costs, cost], f"shared motion {common.status}"
    return JointMotion(
        state, cameras, motion.uncached(), common.spread, costs, status, fit, scene.swapped
    )


def shared_shapes(state: MotionState, performers: Sequence[int]) -> MotionState:
    """The mean shape of a performer's videos for every one of them."""
    return replace(state, betas=mean_shapes(state, performers)[list(performers)])


def _alternate(
    scene: Scene,
    state: MotionState,
    cameras: Cameras,
    options: MotionParams,
    progress: Progress,
) -> JointMotion:
    """Section 3.2, "Optimization": the alternations of Eq. 8."""
    costs = []
    for round_ in range(options.rounds):
        progress(f"coupled fit {round_ + 1} of {options.rounds}")
        state, cameras, cost = low_rank_round(scene, state, cameras, options, pnp=round_ > 0)
        costs.append(cost)
    common = consensus_motion(scene, state, cameras, options.agreement_rad)
    spread = estimate_spread(scene, common, cameras, options)
    status = f"{options.rounds} alternations of Eq. 8"
    fit = misfit(scene, common, cameras)
    return JointMotion(state, cameras, common, spread, costs, status, fit, scene.swapped)


def _single_video(scene: Scene, start: MotionState) -> JointMotion:
    eye, zero = torch.eye(3).to(start.trans)[None], torch.zeros(1, 3).to(start.trans)
    cameras = Cameras(eye, zero, scene.K.to(eye))
    status = "one video: the monocular motion stands"
    return JointMotion(start, cameras, None, None, [], status, 0.0, scene.swapped)

"""SMPL-BA: the motion of every video and all cameras, jointly (Eq. 8).

Two ways behind one parameter. ``paper`` alternates as the paper does: Z and Y by SVD, poses and
paths by the solver, cameras by PnP. ``shared`` (default) starts from one such round, then fits
ONE motion to all views' 2D at once and gives each video back as much freedom as its own image
evidence asks for. ``single`` stops before that last step: one model for all videos.
"""

from dataclasses import replace

import torch

from imocap_core.motion.monocular.fit import Progress
from imocap_core.motion.multiview.common import common_then_own, misfit
from imocap_core.motion.multiview.consensus import Cameras, align, cameras_from_motion
from imocap_core.motion.multiview.coupled import consensus_motion, coupled_round
from imocap_core.motion.multiview.scene import JointMotion, Scene
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
) -> JointMotion:
    """SMPL-BA from motions in their own camera axes (batch of M) and correspondences.

    Args:
        cameras: where a round before left them; its motions, being joint ones, need no coupling
            before the common fit (``paper`` alternates all the same).
    """
    if len(scene.observations) == 1:
        eye, zero = torch.eye(3).to(start.trans)[None], torch.zeros(1, 3).to(start.trans)
        status = "one video: the monocular motion stands"
        return JointMotion(start, Cameras(eye, zero, scene.K.to(eye)), start, [], status, 0.0)
    state, costs = one_body(start), []
    if cameras is not None and options.objective != "paper":
        return common_then_own(scene, state, cameras, options, progress, warm=True)
    aligned = align(scene.body, state, scene.timeline)
    cameras = cameras_from_motion(aligned, scene.K.to(start.trans), scene.reference)
    if options.objective == "paper":
        rounds, coupled = options.rounds, options
    else:  # only a start for the common fit
        rounds, coupled = 1, replace(options, max_steps=min(START_STEPS, options.max_steps))
    for round_ in range(rounds):
        progress(f"coupled fit {round_ + 1} of {rounds}")
        pnp = options.objective == "paper" and round_ > 0
        state, cameras, cost = coupled_round(scene, state, cameras, coupled, pnp=pnp)
        costs.append(cost)
    if options.objective == "paper":
        common = consensus_motion(scene, state, cameras, options)
        said = f"{rounds} alternations of Eq. 8"
        return JointMotion(state, cameras, common, costs, said, misfit(scene, common, cameras))
    found = common_then_own(scene, state, cameras, options, progress)
    return replace(found, costs=[*costs, *found.costs])


def one_body(state: MotionState) -> MotionState:
    """All videos show one performer: everybody starts with the mean shape."""
    mean = state.betas.mean(0, keepdim=True)
    return replace(state, betas=mean.expand_as(state.betas).clone())

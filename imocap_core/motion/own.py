"""From the common motion back to every video's own."""

from dataclasses import replace

import numpy as np
import torch

from imocap_core.motion.consensus import Cameras, pelvis
from imocap_core.motion.coupling import Targets, coupling_terms, to_own_axes, to_own_time
from imocap_core.motion.deviation import joint_spread_rad
from imocap_core.motion.scene import JointOptions, Scene, own_terms, solve
from imocap_core.motion.state import MotionState


def own_deviations(
    scene: Scene,
    state: MotionState,
    shared: MotionState,
    cameras: Cameras,
    spread_m: np.ndarray,
    options: JointOptions,
) -> tuple[MotionState, float]:
    """Each video from its own image, drawn to the common motion as strongly as it follows it.

    Args:
        spread_m: (M, N, K) how far keypoints stray from the common motion (`deviation`).
    """
    start = single_motion(scene, state, shared, cameras)
    targets = _targets(scene, start, shared, cameras)
    spread = joint_spread_rad(scene.body, shared, spread_m)
    once = max(1.0, options.correlation_s * scene.fps)
    on_axis = torch.as_tensor(1 / (spread**2 * once)).to(state.trans)
    joint_weight = to_own_time(on_axis, scene.timeline, state)
    path_weight = torch.full_like(targets.trust, options.coupling_path_m**-2 / once)
    terms = own_terms(scene, start.trans)
    terms += coupling_terms(scene.body, targets, start, joint_weight, path_weight)
    solution = solve(terms, start, options, one_body=True)
    return solution.state, solution.costs[-1]


def single_motion(
    scene: Scene, state: MotionState, shared: MotionState, cameras: Cameras
) -> MotionState:
    """The common motion at every matched frame of every video; unmatched frames keep theirs."""
    targets = _targets(scene, state, shared, cameras)
    matched = (targets.trust > 0)[..., None]
    rest = scene.body.model.shape(shared.betas).joints_rest[:, 0]
    return replace(
        state,
        R_local=torch.where(matched[..., None, None], targets.R_local, state.R_local),
        trans=torch.where(matched, targets.pelvis - rest[:, None], state.trans),
        betas=shared.betas.expand_as(state.betas).clone(),
    )


def _targets(scene: Scene, state: MotionState, shared: MotionState, cameras: Cameras) -> Targets:
    videos = len(scene.observations)
    Z = shared.R_local.expand(videos, -1, -1, -1, -1)
    Y = pelvis(scene.body, shared).expand(videos, -1, -1)
    return to_own_axes(Z, Y, cameras, scene.timeline, scene.confidences, state)

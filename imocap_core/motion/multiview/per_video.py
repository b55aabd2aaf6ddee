"""From the common motion back to every video's own."""

from dataclasses import replace

import torch
from torch import Tensor

from imocap_core.motion.multiview.consensus import Cameras, pelvis
from imocap_core.motion.multiview.coupling import Targets, coupling_terms, to_own_axes, to_own_time
from imocap_core.motion.multiview.deviation import Spread, joint_spread_rad
from imocap_core.motion.multiview.scene import Scene, correlation_frames, own_terms, solve
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms import StandingFeet, Term
from imocap_core.motion.terms.foot_contact import standing_share
from imocap_core.params import MotionParams
from imocap_core.robust import geman_mcclure_weight
from imocap_core.rotations import geodesic_angle

FACING_RAD = 0.6  # beyond a monocular estimate's own errors
FACING_FRAMES = 7
STANDING_M_S, SWINGING_M_S = 0.05, 0.2  # of a foot by the common motion, by one video alone
HOLD = 4.0  # square root of what a foot that stands would pay at most for a step


def own_deviations(
    scene: Scene,
    state: MotionState,
    shared: MotionState,
    cameras: Cameras,
    spread: Spread,
    options: MotionParams,
    *,
    warm: bool = False,
) -> tuple[MotionState, float]:
    """Each video from its own image, drawn to the common motion as strongly as it follows it.

    Args:
        state: what each video said before; warm: it is such a fit, and the start of this one.
    """
    targets = targets_of(scene, state, shared, cameras)
    faces = facing_alike(state, targets)
    common = _released(single_motion(scene, state, shared, cameras), state, faces)
    start = replace(state, betas=common.betas) if warm else common
    terms = [*own_terms(scene, start.trans), held_feet(scene, common, state)]
    terms += deviation_terms(scene, common, shared, cameras, spread, options, faces)
    solution = solve(terms, start, options, one_body=True)
    return solution.state, solution.costs[-1]


def deviation_terms(
    scene: Scene,
    start: MotionState,
    shared: MotionState,
    cameras: Cameras,
    spread: Spread,
    options: MotionParams,
    faces: Tensor,
) -> list[Term]:
    """What draws each video to the common motion, a deviation counted once per correlation time.

    Args:
        start: the common motion at every video's own frames (unmatched ones keep their own).
    """
    targets = targets_of(scene, start, shared, cameras)
    joints = joint_spread_rad(scene.body, shared, spread.keypoints_m)
    joints[:, :, 0] = spread.whole[:, None, 0]
    once = correlation_frames(options, scene.fps)
    on_axis = torch.as_tensor(1 / (joints**2 * once)).to(start.trans)
    joint_weight = to_own_time(on_axis, scene.timeline, start)
    joint_weight[..., 0] *= faces
    path_weight = torch.as_tensor(1 / (spread.whole[:, 3:4] ** 2 * once)).to(start.trans)
    return coupling_terms(scene.body, targets, start, joint_weight, path_weight)


def held_feet(scene: Scene, common: MotionState, own: MotionState) -> Term:
    """Feet that stand hold their place: all videos have voted in the common motion, none objects.

    Args:
        common: the common motion at every video's own frames; own: what each video said before.
    """
    hold = (scene.fps / scene.weights.foot_hold_m_s) ** 2
    voted = standing_share(scene.body, common, scene.fps, speed_m_s=STANDING_M_S)
    stands = standing_share(scene.body, own, scene.fps, speed_m_s=SWINGING_M_S)
    return StandingFeet(scene.body, hold * voted * stands, HOLD)


def facing_alike(state: MotionState, targets: Targets) -> Tensor:
    """(B, T) in [0, 1]: whether a performance faces where the common motion does.

    A performer may turn to another side for a while. Geman-McClure weight of the angle between the
    two root orientations, averaged over `FACING_FRAMES`, so that noise alone releases nobody.
    """
    angle = geodesic_angle(state.R_local[:, :, 0], targets.R_local[:, :, 0])
    half = FACING_FRAMES // 2
    padded = torch.nn.functional.pad(angle[:, None], (half, half), mode="replicate")
    angle = padded.unfold(-1, 2 * half + 1, 1).mean(-1)[:, 0]
    return geman_mcclure_weight(angle, FACING_RAD)


def _released(start: MotionState, own: MotionState, faces: Tensor) -> MotionState:
    """A start that keeps its own root orientation where it faces another way."""
    R_local = start.R_local.clone()
    other_way = (faces < 0.25)[..., None, None]
    R_local[:, :, 0] = torch.where(other_way, own.R_local[:, :, 0], R_local[:, :, 0])
    return replace(start, R_local=R_local)


def single_motion(
    scene: Scene, state: MotionState, shared: MotionState, cameras: Cameras
) -> MotionState:
    """The common motion at every matched frame of every video; unmatched frames keep theirs."""
    targets = targets_of(scene, state, shared, cameras)
    matched = (targets.trust > 0)[..., None]
    rest = scene.body.model.shape(shared.betas).joints_rest[:, 0]
    return replace(
        state,
        R_local=torch.where(matched[..., None, None], targets.R_local, state.R_local),
        trans=torch.where(matched, targets.pelvis - rest[:, None], state.trans),
        betas=shared.betas.expand_as(state.betas).clone(),
    )


def targets_of(scene: Scene, state: MotionState, shared: MotionState, cameras: Cameras) -> Targets:
    """The common motion at every video's frames and in its axes."""
    videos = len(scene.observations)
    Z = shared.R_local.expand(videos, -1, -1, -1, -1)
    Y = pelvis(scene.body, shared).expand(videos, -1, -1)
    return to_own_axes(Z, Y, cameras, scene.timeline, scene.confidences, state)

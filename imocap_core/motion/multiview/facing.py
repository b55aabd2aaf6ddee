"""Facing: does a performance face another way than the common motion, or did its fit go wrong?

A performer may face another side for a while, and then the video's root orientation must not follow
the common motion. But a monocular fit may also take the back for the front, or reverse depth, and
then the same difference of root orientations is an error that the common motion repairs. The
keypoints tell one from the other: with the common articulation, the root orientation that is right
explains them better.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.multiview.coupling import CouplingTargets
from imocap_core.motion.multiview.scene import Scene
from imocap_core.motion.observations import per_video_view
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms.view import View, project
from imocap_core.motion.window import running_mean
from imocap_core.robust import geman_mcclure_weight
from imocap_core.rotations import geodesic_angle

FACING_RAD = 0.6  # beyond a monocular estimate's own errors
FACING_FRAMES = 7
EVIDENCE_FRAMES = 15  # over which the keypoints of single frames are averaged


def facing_agreement(
    scene: Scene, state: MotionState, targets: CouplingTargets
) -> Float[Tensor, "B T"]:
    """Weight of a performance's coupling to the common root orientation.

    The Geman-McClure weight of the angle between the two, averaged over `FACING_FRAMES` so that
    noise alone releases no root orientation; 1 where the keypoints speak for the common one.

    Args:
        state: every video's motion; targets: the common motion at its frames and in its axes.
    """
    faces = geman_mcclure_weight(turned_by(state, targets), FACING_RAD)
    return torch.where(refuted(scene, state, targets), torch.ones_like(faces), faces)


def turned_by(state: MotionState, targets: CouplingTargets) -> Float[Tensor, "B T"]:
    """Angle between a performance's root orientation and the common one, smoothed."""
    angle = geodesic_angle(state.R_local[:, :, 0], targets.R_local[:, :, 0])
    return _smoothed(angle, FACING_FRAMES)


def refuted(scene: Scene, state: MotionState, targets: CouplingTargets) -> Tensor:
    """(B, T) where the common root orientation explains the keypoints better than the video's."""
    view = per_video_view(scene.observations, state.trans)
    turned = targets.R_local.clone()
    turned[:, :, 0] = state.R_local[:, :, 0]
    residual, shared = (
        _smoothed(_unexplained(scene, view, replace(state, R_local=R)), EVIDENCE_FRAMES)
        for R in (turned, targets.R_local)
    )
    return shared < residual


def _unexplained(scene: Scene, view: View, state: MotionState) -> Float[Tensor, "B T"]:
    """Share of the keypoints' squared spread that a pose leaves under its best scale and shift."""
    pixels, _ = project(view, scene.body.positions(scene.body.keypoints, state).xyz)
    weight = view.weight[..., None]
    total = weight.sum(2, keepdim=True).clamp_min(1e-12)
    p, x = (q - (weight * q).sum(2, keepdim=True) / total for q in (pixels, view.xy_px))
    product, spread, size = ((weight * a * b).sum((2, 3)) for a, b in ((p, x), (p, p), (x, x)))
    explained = product.clamp_min(0.0).square() / (spread * size).clamp_min(1e-12)
    return torch.where(size > 0, 1.0 - explained, 0.0)


def _smoothed(values: Float[Tensor, "B T"], frames: int) -> Float[Tensor, "B T"]:
    """Centred mean of an odd number of frames."""
    return running_mean(values[:, None], frames // 2)[:, 0]

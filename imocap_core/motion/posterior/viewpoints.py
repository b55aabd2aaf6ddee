"""Which further viewpoint would help most: the common motion's variance after one more camera."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from imocap_core.motion.kinematics import Body
from imocap_core.motion.multiview.rigid_offsets import first_strays
from imocap_core.motion.posterior.azimuth import Stage
from imocap_core.motion.posterior.common_posterior import CommonPosterior
from imocap_core.motion.posterior.joint_covariance import joint_jacobian
from imocap_core.motion.solver.normal import NormalEquations
from imocap_core.motion.solver.selected import factorise
from imocap_core.motion.state import FRAME_UNKNOWNS, MotionState
from imocap_core.motion.terms import Reprojection, View
from imocap_core.motion.terms.view import project
from imocap_core.params import MotionParams
from imocap_core.workers import at_once

Array = NDArray[np.float64]
AZIMUTHS_DEG = tuple(range(0, 360, 45))


@dataclass(frozen=True)
class Spec:
    """A camera as the given ones are: metres, pixels, 1/px^2, standard deviations (6,)."""

    distance_m: float
    focal_px: float
    weight: float
    stray: Array


def reductions(
    body: Body,
    motion: MotionState,
    normal: NormalEquations,
    stage: Stage,
    spec: Spec,
    *,
    scale: float,
    share: float,
) -> Array:
    """(8,) share by which the joints' summed variance falls with one more camera at each azimuth.

    The camera is level with the performer's middle and as far away, as sharp and as free to stray
    as the given ones are; its ``J^T W J`` is added and the inverse selected anew. What a body hides
    of itself is not considered; cameras and shape are taken as known.

    Args:
        motion: batch of 1, N frames, world axes; normal: its normal matrix.
        scale: of the robust loss; share: what one frame's image evidence counts (`Noise`).
    """
    rows, _ = joint_jacobian(body, motion)

    def variance(seen: Tensor) -> float:
        blocks = normal.diagonal[0] + share * seen
        factored = factorise(blocks, normal.next1[0], normal.next2[0])
        return _summed(rows, factored.inverse_diagonal())

    def with_camera(azimuth_deg: float) -> float:
        own = replace(motion, camera_R=motion.camera_R[:, :0], camera_t=motion.camera_t[:, :0])
        view = _camera(body, own, stage, spec, azimuth_deg)
        count, shape = own.valid.shape[1], own.betas.shape[1]
        added = NormalEquations.zeros(1, count, FRAME_UNKNOWNS, shape, own.trans)
        Reprojection(body, (view,), scale).add_to(added, own)
        return variance(added.diagonal[0])

    before = variance(torch.zeros_like(normal.diagonal[0]))
    return 1 - np.array(at_once(with_camera, AZIMUTHS_DEG)) / before


def _summed(rows: Tensor, covariance: Tensor) -> float:
    half = rows.flatten(1, 2) @ covariance
    return float((half * rows.flatten(1, 2)).sum())


def _camera(body: Body, motion: MotionState, stage: Stage, spec: Spec, azimuth_deg: float) -> View:
    """A view that finds the motion where it is."""
    outward = stage.outward(azimuth_deg)
    R = np.stack([np.cross(stage.up, outward), -stage.up, -outward])
    t = -R @ (stage.middle + spec.distance_m * outward)
    K = np.diag([spec.focal_px, spec.focal_px, 1.0])
    like = motion.trans
    K_, R_, t_ = (torch.as_tensor(x).to(like)[None] for x in (K, R, t))
    xyz = body.positions(body.keypoints, motion).xyz
    weight = torch.full(xyz.shape[:3], spec.weight).to(like)
    stray = torch.as_tensor(spec.stray**-2.0).to(like).expand(1, xyz.shape[1], -1)
    view = View(xyz[..., :2], weight, K_, R_, t_, stray=stray)
    return replace(view, xy_px=project(view, xyz)[0])


def spec_of(common: CommonPosterior) -> Spec:
    """A camera like those there are."""
    evidence, motion = common.common.evidence, common.common.motion
    cameras = common.common.cameras
    depth = motion.trans[0].mean(0) @ cameras.R.mT + cameras.t
    return Spec(
        float(depth[:, 2].median()),
        float(cameras.K[:, 0, 0].median()),
        float(np.median(evidence.weight[evidence.weight > 0])),
        np.sqrt(np.square(common.common.spread.whole).mean(0)),
    )


def spec_alone(motion: MotionState, own: View, options: MotionParams) -> Spec:
    """A second camera for a video that has none beside it: it may stray generously."""
    weight = own.weight[own.weight > 0]
    return Spec(
        float(motion.trans[0, :, 2].median()),
        float(own.K[0, 0, 0]),
        float(weight.median()) if len(weight) else 0.0,
        first_strays(1, options)[0],
    )

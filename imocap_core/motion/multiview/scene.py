"""What SMPL-BA works on, how it proceeds, and what it returns."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from imocap_core.motion.kinematics import Body
from imocap_core.motion.monocular.fit import monocular_terms
from imocap_core.motion.multiview.consensus import Cameras
from imocap_core.motion.multiview.timeline import Timeline
from imocap_core.motion.observations import Observation
from imocap_core.motion.prior import PosePrior
from imocap_core.motion.solver.gauss_newton import Solution, gauss_newton
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms import Term
from imocap_core.params import FitParams, MotionParams


@dataclass(frozen=True)
class Scene:
    """Everything that stays fixed while SMPL-BA runs.

    Attributes:
        confidences: per video (T_v,) trust in each frame's correspondence.
        reference: index of the video whose camera is the world.
    """

    body: Body
    prior: PosePrior
    observations: Sequence[Observation]
    timeline: Timeline
    confidences: list[NDArray[np.float64]]
    reference: int
    weights: FitParams

    @property
    def K(self) -> Tensor:
        """(M, 3, 3) intrinsics that are known or assumed."""
        return torch.as_tensor(np.stack([o.K for o in self.observations]))

    def through(self, cameras: Cameras) -> "Scene":
        """The same seen by cameras whose focal lengths were found."""
        return replace(self, observations=through(self.observations, cameras))

    @property
    def fps(self) -> float:
        """Frame rate of the reference."""
        return self.observations[self.reference].fps


@dataclass(frozen=True)
class JointMotion:
    """What SMPL-BA returns.

    Attributes:
        state: every video's motion in its own camera's axes (batch of M).
        cameras: from the world, which is the reference's camera axes.
        shared: the motion common to all on the reference's axis (batch of 1), world axes.
        costs: the objective after each solve; status: a sentence.
        misfit: mean robust reprojection cost a keypoint of the motion common to all videos: how
            well the correspondences explain every image at once. Lower is better.
    """

    state: MotionState
    cameras: Cameras
    shared: MotionState
    costs: list[float]
    status: str
    misfit: float


def correlation_frames(options: MotionParams, fps: float) -> float:
    """Frames over which errors and deviations persist: evidence of that many counts once."""
    return max(1.0, options.correlation_s * fps)


def through(observations: Sequence[Observation], cameras: Cameras) -> list[Observation]:
    """What was seen, by cameras whose focal lengths were found."""
    rows = zip(observations, cameras.K.cpu().numpy(), strict=True)
    return [replace(o, K=K) for o, K in rows]


def solve(
    terms: Sequence[Term], state: MotionState, options: MotionParams, *, one_body: bool
) -> Solution:
    """Minimise by damped Gauss-Newton."""
    return gauss_newton(
        terms,
        state,
        max_steps=options.max_steps,
        relative_tolerance=1e-3,
        shared_globals=one_body,
    )


def own_terms(scene: Scene, like: Tensor) -> list[Term]:
    """Every video's own image evidence and regularisers."""
    return monocular_terms(
        scene.body, scene.prior, scene.observations, like, scene.weights, scale=1.0
    )

"""What SMPL-BA works on, and what it returns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from imocap_core.motion.kinematics import Body
from imocap_core.motion.monocular.fit import monocular_terms
from imocap_core.motion.multiview.cameras import Cameras
from imocap_core.motion.multiview.timeline import BeyondReference, Timeline
from imocap_core.motion.observations import Observation
from imocap_core.motion.prior import PosePrior
from imocap_core.motion.solver.gauss_newton import Solution, gauss_newton
from imocap_core.motion.state import MotionState
from imocap_core.motion.terms import Term
from imocap_core.params import FitParams, MotionParams

TOLERANCE = 1e-3  # share of the objective that the last step of a solve lowers it by


@dataclass(frozen=True)
class Scene:
    """Everything that stays fixed while SMPL-BA runs.

    Attributes:
        confidences: per video (T_v,) trust in each frame's correspondence.
        reference: index of the video whose camera is the world.
        beyond: per video, its frames that the reference does not show.
    """

    body: Body
    prior: PosePrior
    observations: Sequence[Observation]
    timeline: Timeline
    confidences: list[Float[np.ndarray, " _"]]
    reference: int
    fit: FitParams
    beyond: Sequence[BeyondReference] = ()

    @property
    def K(self) -> Float[Tensor, "M 3 3"]:
        """Intrinsics as given or assumed."""
        return torch.as_tensor(np.stack([o.K for o in self.observations]))

    def with_intrinsics(self, cameras: Cameras) -> Scene:
        """The same scene with the intrinsics of solved cameras."""
        return replace(self, observations=with_intrinsics(self.observations, cameras))

    @property
    def performers(self) -> list[int]:
        """Of each video, the number of the person shown."""
        return [o.performer for o in self.observations]

    @property
    def swapped(self) -> tuple[Int[np.ndarray, " _"], ...]:
        """Of each video, which sides of its detections are swapped (`Observation.swapped`)."""
        return tuple(o.swapped_states for o in self.observations)

    @property
    def fps(self) -> float:
        """Frame rate of the reference."""
        return self.observations[self.reference].fps


@dataclass(frozen=True)
class DeviationSpread:
    """Standard deviations of performances from the common motion.

    Attributes:
        keypoints_m: (M, N, K) of each keypoint, per coordinate, metres.
        offset_sd: (M, 6) of the per-frame rigid offset: three rotations (rad), three translations
            (m).
    """

    keypoints_m: Float[np.ndarray, "M N K"]
    offset_sd: Float[np.ndarray, "M 6"]


@dataclass(frozen=True)
class JointMotion:
    """What SMPL-BA returns.

    Attributes:
        state: every video's motion in its own camera's axes (batch of M).
        cameras: from the world, which is the reference's camera axes.
        common: the motion common to all at the reference's frames (batch of 1), world axes; None
            for a single video, like its spread.
        spread: how far each performance deviates from it.
        costs: the objective after each solve; status: a sentence.
        misfit: mean robust reprojection cost per keypoint of the common motion: how well the
            correspondences explain all images at once. Lower is better.
        swapped: of each video (T_v,), which sides of its detections the solve swapped (states of
            `sync.hypotheses.swapped_sides.swapped_by_others`); empty where none were judged.
    """

    state: MotionState
    cameras: Cameras
    common: MotionState | None
    spread: DeviationSpread | None
    costs: list[float]
    status: str
    misfit: float
    swapped: tuple[Int[np.ndarray, " _"], ...] = ()


def correlation_frames(options: MotionParams, fps: float) -> float:
    """Frames over which errors and deviations persist: evidence of that many counts once."""
    return max(1.0, options.correlation_s * fps)


def with_intrinsics(observations: Sequence[Observation], cameras: Cameras) -> list[Observation]:
    """Observations with the intrinsics of solved cameras."""
    rows = zip(observations, cameras.K.cpu().numpy(), strict=True)
    return [replace(o, K=K) for o, K in rows]


def solve(
    terms: Sequence[Term],
    state: MotionState,
    max_steps: int,
    *,
    performers: Sequence[int] | None = None,
) -> Solution:
    """Minimise by damped Gauss-Newton; the motions of one of the ``performers`` share their shape,
    without any every motion has its own."""
    return gauss_newton(
        terms,
        state,
        max_steps=max_steps,
        relative_tolerance=TOLERANCE,
        shared_globals=performers is not None,
        bodies=performers,
    )


def per_video_terms(scene: Scene, template: Tensor) -> list[Term]:
    """Every video's own image evidence and regularisers; template: gives dtype and device."""
    return monocular_terms(
        scene.body, scene.prior, scene.observations, template, scene.fit, scale=1.0
    )

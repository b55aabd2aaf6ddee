"""Positions of the body's keypoints and joints for a state, and their derivatives."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from imocap_core.body import (
    Model,
    PointSet,
    Posed,
    join_points,
    pick_points,
    points_with_jacobian,
)
from imocap_core.motion.state import MotionState

FEET = ("left_ankle", "right_ankle", "left_foot", "right_foot")
MOVING = (
    *(f"{side}_{end}" for end in ("hip", "knee", "ankle") for side in ("left", "right")),
    *(f"{side}_{end}" for end in ("shoulder", "elbow", "wrist") for side in ("left", "right")),
    "head",
)


@dataclass(frozen=True)
class Points:
    """Positions of K points and their derivatives (None where not computed).

    Attributes:
        xyz: (B, T, K, 3) metres.
        d_pose: (B, T, K, 3, 72) by the local increments; d_beta: (B, T, K, 3, 10).
    """

    xyz: Float[Tensor, "B T K 3"]
    d_pose: Float[Tensor, "B T K 3 72"] | None = None
    d_beta: Float[Tensor, "B T K 3 10"] | None = None


@dataclass(frozen=True)
class Body:
    """A body model with the keypoints of one layout, the 24 joints, and some of them: those of the
    feet, and those that move by themselves (limbs and head)."""

    model: Model
    keypoints: PointSet
    joints: PointSet
    feet: PointSet
    moving: PointSet

    @classmethod
    def of(cls, model: Model, *layouts: str) -> Body:
        """The model with the keypoints of one or several layouts, one after another."""
        joints = model.points("smpl24")
        keypoints = join_points([model.points(x) for x in layouts])
        feet, moving = pick_points(joints, FEET), pick_points(joints, MOVING)
        return cls(model, keypoints, joints, feet, moving)

    def posed(self, state: MotionState) -> Posed:
        """The body in the state's shape and poses."""

        def pose() -> Posed:
            return self.model.shape(state.betas[:, None]).pose(state.R_local, state.trans)

        return state.cached((self.model,), pose)

    def positions(self, points: PointSet, state: MotionState) -> Points:
        """Positions only."""
        posed = self.posed(state)
        return state.cached((self.model, points), lambda: Points(posed.keypoints(points)))

    def derivatives(
        self, points: PointSet, state: MotionState, frames: slice = slice(None)
    ) -> Points:
        """Positions and their derivatives, of some frames."""
        posed = self.posed(state)
        moving = (x[:, frames] for x in (posed.R_local, posed.transl, posed.R_world))
        return Points(*points_with_jacobian(Posed(posed.shaped, *moving), points))

"""Balance: a body's centre of mass is above the limbs that it stands on."""

from __future__ import annotations

from dataclasses import dataclass, replace

from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.kinematics import Body, Points
from imocap_core.motion.solver.normal import NormalEquations, add_product
from imocap_core.motion.state import POSE, MotionState
from imocap_core.motion.terms.in_time import pieces
from imocap_core.robust import cauchy


@dataclass(frozen=True)
class Balance:
    """Horizontal distance of the centre of mass from the middle of its support.

    Both are weighted means of the joints, whose weights are constant; so is gravity. Translation
    does not enter.

    Attributes:
        body: whose 24 joints.
        arm: (B, T, 24) weights of the centre of mass less those of the support's middle.
        whiten: (B, T, 2, 3) from an arm in metres to horizontal coordinates in standard deviations;
            0 where nothing is claimed.
        weight: cost of one standard deviation.
        scale: Cauchy scale, standard deviations.
    """

    body: Body
    arm: Float[Tensor, "B T 24"]
    whiten: Float[Tensor, "B T 2 3"]
    weight: float
    scale: float

    def of(self, v: int, frames: int) -> Balance:
        """One motion's frames."""
        row = slice(v, v + 1)
        return replace(self, arm=self.arm[row, :frames], whiten=self.whiten[row, :frames])

    def residual(self, xyz: Float[Tensor, "B T 24 3"]) -> Float[Tensor, "B T 2"]:
        """Horizontal arm of the centre of mass, in standard deviations."""
        return (self.whiten @ (self.arm[..., None] * xyz).sum(-2)[..., None])[..., 0]

    def cost(self, state: MotionState) -> Float[Tensor, " B"]:
        """Cost of each motion."""
        squared = self.residual(self.body.positions(self.body.joints, state).xyz).square().sum(-1)
        return self.weight * (cauchy(squared, self.scale)[0] * state.valid).sum(1)

    def add_to(self, normal: NormalEquations, state: MotionState) -> None:
        """The residual is linear in the joints, so its rows are the joints' derivatives, summed."""
        for frames in pieces(state.valid.shape[1]):
            points = self.body.derivatives(self.body.joints, state, frames)
            part = replace(self, arm=self.arm[:, frames], whiten=self.whiten[:, frames])
            part._add_piece(normal.of_frames(frames), points, state.valid[:, frames])

    def _add_piece(self, normal: NormalEquations, points: Points, valid: Tensor) -> None:
        assert points.d_pose is not None
        assert points.d_beta is not None
        residual = self.residual(points.xyz)
        weight = self.weight * cauchy(residual.square().sum(-1), self.scale)[1] * valid
        pose, shape = (
            self.whiten @ (self.arm[:, :, None] @ x.flatten(3)).view(*x.shape[:2], 3, -1)
            for x in (points.d_pose, points.d_beta)
        )
        count = shape.shape[-1]
        by_pose, by_shape = (weight[..., None, None] * x for x in (pose, shape))
        pulled = residual[..., None]
        add_product(normal.diagonal[..., :POSE, :POSE], pose, by_pose)
        normal.border[..., :POSE, :count] += by_pose.mT @ shape
        normal.corner[:, :count, :count] += (shape.mT @ by_shape).sum(1)
        normal.gradient[..., :POSE] += (by_pose.mT @ pulled)[..., 0]
        normal.corner_gradient[:, :count] += (by_shape.mT @ pulled)[..., 0].sum(1)

"""Views and unknowns of a batch of hands over time, each hand in one or more views.

A hand's wrist turns against the forearm, which the body's fit gives for every view; so one hand
that is common to several videos has one set of rotations, and every view its own forearm, place of
the wrist and camera.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from imocap_core.rotations import exp


@dataclass(frozen=True)
class HandViews:
    """B hands of T frames in V views each (batch first in every tensor).

    Attributes:
        bones: (B, 5, 4, 3), axes: (B, 5, 3, 3, 21): the skeleton of each hand.
        R_forearm: (B, T, V, 3, 3) camera from forearm; wrist_m: (B, T, V, 3) in camera axes;
            K: (B, V, 3, 3).
        xy_px: (B, T, V, 21, 2); weight: (B, T, V, 21) 1/px^2, 0 for a missing one.
        R_body: (B, T, 3, 3) forearm from hand as the body's fit has it.
        valid: (B, T) bool, False pads.
    """

    bones: Float[Tensor, "B 5 4 3"]
    axes: Float[Tensor, "B 5 3 3 21"]
    R_forearm: Float[Tensor, "B T V 3 3"]
    wrist_m: Float[Tensor, "B T V 3"]
    K: Float[Tensor, "B V 3 3"]
    xy_px: Float[Tensor, "B T V 21 2"]
    weight: Float[Tensor, "B T V 21"]
    R_body: Float[Tensor, "B T 3 3"]
    valid: Bool[Tensor, "B T"]

    def frames(self, index: Int[Tensor, " N"]) -> HandViews:
        """Some frames of the batch."""
        per_frame = ("R_forearm", "wrist_m", "xy_px", "weight", "R_body", "valid")
        return replace(self, **{name: getattr(self, name)[:, index] for name in per_frame})

    def single_frames(self, copies: int) -> HandViews:
        """Every frame as a motion of its own, `copies` times: batch B T copies of one frame."""
        batch, frames = self.valid.shape
        parts = {}
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in ("bones", "axes", "K"):
                value = value[:, None].expand(batch, frames, *value.shape[1:])
            value = value.flatten(0, 1)[:, None].expand(-1, copies, *value.shape[2:])
            value = value.flatten(0, 1)
            parts[field.name] = value if field.name in ("bones", "axes", "K") else value[:, None]
        return HandViews(**parts)


@dataclass(frozen=True)
class HandState:
    """The unknowns.

    Attributes:
        R_wrist: (B, T, 3, 3) forearm from hand; angles: (B, T, 21) radians.
        offset_m: (B, T, V, 3) of the wrist from the body's, camera axes.
        size: factor of the bones, one for all.
    """

    R_wrist: Float[Tensor, "B T 3 3"]
    angles: Float[Tensor, "B T 21"]
    offset_m: Float[Tensor, "B T V 3"]
    size: float = 1.0

    def retract(self, step: Float[Tensor, "B T n"]) -> HandState:
        """The state after increments, n = 24 + 3 V of a frame."""
        return replace(
            self,
            R_wrist=self.R_wrist @ exp(step[..., :3]),
            angles=self.angles + step[..., 3:24],
            offset_m=self.offset_m + step[..., 24:].reshape(self.offset_m.shape),
        )

    def where(self, chosen: Bool[Tensor, " B"], other: HandState) -> HandState:
        """This state in the chosen hands of the batch, the other state elsewhere."""

        def pick(a: Tensor, b: Tensor) -> Tensor:
            return torch.where(chosen.reshape(-1, *[1] * (a.ndim - 1)), a, b)

        return replace(
            self,
            R_wrist=pick(self.R_wrist, other.R_wrist),
            angles=pick(self.angles, other.angles),
            offset_m=pick(self.offset_m, other.offset_m),
        )


@dataclass(frozen=True)
class CommonHand:
    """The hand motion common to all videos.

    Attributes:
        R_wrist: (B, T, 3, 3) forearm from hand; angles: (B, T, 21) radians.
        trust: (B, T) in [0, 1] of each frame's correspondence.
    """

    R_wrist: Float[Tensor, "B T 3 3"]
    angles: Float[Tensor, "B T 21"]
    trust: Float[Tensor, "B T"]

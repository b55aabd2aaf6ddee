"""Running means over time."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor


def running_mean(values: Float[Tensor, "B C T"], half: int) -> Float[Tensor, "B C T"]:
    """Centred means of 2 half + 1 frames, the first and last frame repeated beyond the ends."""
    padded = torch.nn.functional.pad(values, (half, half), mode="replicate")
    return padded.unfold(-1, 2 * half + 1, 1).mean(-1)

"""Embeddings of a moment: a few neighbouring frames in, one vector out.

The input is a window, not the whole clip: a network that sees the ends of the clip could count
frames from there, which satisfies every cycle and is meaningless.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

_HIDDEN = 128


class PoseEncoder(nn.Module):
    """Windows of 2D poses to embeddings by 1D convolutions over time; window length W odd."""

    def __init__(self, points: int, taps: int, embedding: int) -> None:
        super().__init__()
        layers: list[nn.Module] = [nn.Conv1d(3 * points, _HIDDEN, 1)]
        for _ in range(taps // 2):
            layers += [nn.ReLU(), nn.Conv1d(_HIDDEN, _HIDDEN, 3)]
        self.over_time = nn.Sequential(*layers, nn.ReLU(), nn.Conv1d(_HIDDEN, embedding, 1))

    def forward(self, windows: Float[Tensor, "N W K 3"]) -> Float[Tensor, "N D"]:
        """One embedding for each window."""
        out: Tensor = self.over_time(windows.flatten(2).transpose(1, 2))
        return out[..., 0]


def encoder_for(item: torch.Size, taps: int, embedding: int) -> nn.Module:
    """The encoder for the items of a clip, poses (K, 3). ValueError for other shapes."""
    if len(item) != 2 or item[1] != 3:
        raise ValueError(f"a frame: expected a pose (K, 3), got {tuple(item)}")
    return PoseEncoder(item[0], taps, embedding)


def mirrored(windows: Float[Tensor, "N W K 3"]) -> Float[Tensor, "N W K 3"]:
    """Windows of poses with the image's left and right swapped.

    The names of the joints stay: but for perspective, this is the pose as seen from the opposite
    side.
    """
    return windows * windows.new_tensor([-1.0, 1.0, 1.0])

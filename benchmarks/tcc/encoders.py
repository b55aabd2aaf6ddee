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


class FrameEncoder(nn.Module):
    """Windows of small pictures to embeddings: one small CNN on each picture, then a convolution
    over all W of them."""

    def __init__(self, channels: int, size: int, taps: int, embedding: int) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        before = channels
        for width in (16, 32, 64, 64):
            layers += [nn.Conv2d(before, width, 3, stride=2, padding=1)]
            layers += [nn.GroupNorm(4, width), nn.ReLU()]
            before = width
        side = -(-size // 16)
        layers += [nn.Flatten(), nn.Linear(before * side * side, _HIDDEN), nn.ReLU()]
        self.picture = nn.Sequential(*layers)
        self.over_time = nn.Sequential(
            nn.Conv1d(_HIDDEN, _HIDDEN, taps), nn.ReLU(), nn.Conv1d(_HIDDEN, embedding, 1)
        )

    def forward(self, windows: Float[Tensor, "N W C S S"]) -> Float[Tensor, "N D"]:
        """One embedding for each window."""
        n, taps = windows.shape[:2]
        features = self.picture(windows.flatten(0, 1)).reshape(n, taps, -1)
        out: Tensor = self.over_time(features.transpose(1, 2))
        return out[..., 0]


def encoder_for(item: torch.Size, taps: int, embedding: int) -> nn.Module:
    """The encoder for the items of a clip: poses (K, 3) or square pictures (channels, S, S).
    ValueError for other shapes."""
    if len(item) == 2 and item[1] == 3:
        return PoseEncoder(item[0], taps, embedding)
    if len(item) == 3 and item[1] == item[2]:
        return FrameEncoder(item[0], item[1], taps, embedding)
    raise ValueError(
        f"a frame: expected a pose (K, 3) or a square picture (channels, S, S), got {tuple(item)}"
    )


def mirrored(windows: Float[Tensor, "N W ..."]) -> Float[Tensor, "N W ..."]:
    """Windows of poses (K, 3) or pictures (channels, S, S) with the image's left and right swapped.

    The names of the joints stay: but for perspective, this is the pose as seen from the opposite
    side.
    """
    if windows.ndim == 5:
        return windows.flip(-1)
    return windows * windows.new_tensor([-1.0, 1.0, 1.0])

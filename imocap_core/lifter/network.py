"""The network: an MLP mixer over a window of frames, with an output for every frame.

Two linear layers mix the frames of a channel, two mix the channels of a frame, in turn (Tolstikhin
et al., "MLP-Mixer", NeurIPS 2021): on a CPU nothing but matrix products.
"""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor, nn

from imocap_core.lifter.rays import FEATURES

WINDOW = 27  # frames
RATE_HZ = 15.0  # of the frames of a window, about
WIDTH = 256
BLOCKS = 6
JOINTS = 24  # SMPL's
HYPOTHESES = 2  # in addition to the mean


@dataclass(frozen=True)
class LifterOutput:
    """The network's output for B windows of L frames, in person-centred camera axes.

    Attributes:
        joints: metres, relative to the pelvis.
        log_variance: logarithm of the expected squared error of each joint in space, m^2.
        alternatives: further hypotheses of the joints.
        logits: of the hypotheses' probabilities.
    """

    joints: Float[Tensor, "B L 24 3"]
    log_variance: Float[Tensor, "B L 24"]
    alternatives: Float[Tensor, "B L H 24 3"]
    logits: Float[Tensor, "B H"]


class _Block(nn.Module):
    def __init__(self, width: int, window: int) -> None:
        super().__init__()
        self.frames_norm = nn.LayerNorm(width)
        self.frames_in = nn.Linear(window, 2 * window)
        self.frames_out = nn.Linear(2 * window, window)
        self.channels_norm = nn.LayerNorm(width)
        self.channels_in = nn.Linear(width, 2 * width)
        self.channels_out = nn.Linear(2 * width, width)

    def forward(self, x: Float[Tensor, "B L D"]) -> Float[Tensor, "B L D"]:
        y = self.frames_norm(x).transpose(1, 2)
        y = self.frames_out(nn.functional.gelu(self.frames_in(y)))
        x = x + y.transpose(1, 2)
        y = self.channels_norm(x)
        return x + self.channels_out(nn.functional.gelu(self.channels_in(y)))


class Lifter(nn.Module):
    """Features of windows of frames (`rays.person_centred_features`) to a `LifterOutput`."""

    def __init__(self, width: int = WIDTH, blocks: int = BLOCKS, window: int = WINDOW) -> None:
        super().__init__()
        self.first = nn.Linear(FEATURES, width)
        self.blocks = nn.ModuleList([_Block(width, window) for _ in range(blocks)])
        self.norm = nn.LayerNorm(width)
        self.joints = nn.Linear(width, JOINTS * 3)
        self.log_variance = nn.Linear(width, JOINTS)
        self.alternatives = nn.Linear(width, HYPOTHESES * JOINTS * 3)
        self.logits = nn.Linear(width, HYPOTHESES)

    def forward(self, features: Float[Tensor, "B L F"]) -> LifterOutput:
        x = self.first(features)
        for block in self.blocks:
            x = block(x)
        x = self.norm(x)
        joints = self.joints(x).float().unflatten(-1, (JOINTS, 3))
        others = self.alternatives(x).float().unflatten(-1, (HYPOTHESES, JOINTS, 3))
        return LifterOutput(
            joints - joints[:, :, :1],
            self.log_variance(x).float(),
            others - others[..., :1, :],
            self.logits(x.mean(1)).float(),
        )

"""The cameras of all videos, and where they are at first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.camera.averaging import mean_rotation, mean_vector
from imocap_core.motion.multiview.aligned import AlignedMotions
from imocap_core.robust import geman_mcclure_weight
from imocap_core.rotations import geodesic_angle
from imocap_core.rotations import mean as chordal_mean

CONSENSUS_RAD = 0.35  # angle to the consensus at which a root orientation counts a quarter
ROUNDS = 4  # of the consensus
PATH_SCALE_M = 0.15  # Geman-McClure scale of the root paths' distances


@dataclass(frozen=True)
class Cameras:
    """One camera a video: ``x_cam = R x_world + t``; the world is the reference's camera axes.

    Attributes:
        R: (M, 3, 3); t: (M, 3) metres; K: (M, 3, 3) intrinsics, pixels.
    """

    R: Float[Tensor, "M 3 3"]
    t: Float[Tensor, "M 3"]
    K: Float[Tensor, "M 3 3"]

    @property
    def focal_px(self) -> Float[np.ndarray, " M"]:
        """Focal lengths."""
        return self.K[:, 0, 0].cpu().numpy()

    def in_axes_of(self, reference: int) -> Cameras:
        """The same cameras with the axes of one of them as the world's."""
        R = self.R @ self.R[reference].T
        return Cameras(R, self.t - R @ self.t[reference], self.K)


def cameras_from_motion(
    aligned: AlignedMotions, K: Float[Tensor, "M 3 3"], reference: int
) -> Cameras:
    """Rigid alignment of all videos' motions (section 3.2, "Initialization").

    With every motion in its own camera's axes, a camera's rotation is a robust average of root
    orientations, its translation a robust mean of distances between root paths. The first consensus
    is the reference alone; each round replaces it by the consensus of all videos, so that every
    pair of videos counts.
    """
    R_root = aligned.R_local[:, :, 0]
    videos = len(R_root)
    R = torch.eye(3).to(R_root).repeat(videos, 1, 1)
    weight = aligned.weight.clone()
    consensus, trust = R_root[reference], weight[reference]
    for _ in range(ROUNDS):
        for v in range(videos):
            relative = R_root[v] @ consensus.transpose(-1, -2)
            share = weight[v] * trust
            if bool((share > 0).any()):
                average = mean_rotation(relative.cpu().numpy(), share.cpu().numpy())
                R[v] = torch.as_tensor(average).to(R)
        R = R @ R[reference].transpose(-1, -2)
        R[reference] = torch.eye(3).to(R)
        in_world = R.transpose(-1, -2)[:, None] @ R_root
        consensus = chordal_mean(in_world, weight)
        angle = geodesic_angle(in_world, consensus[None])
        consensus = chordal_mean(in_world, geman_mcclure_weight(angle, CONSENSUS_RAD, prior=weight))
        trust = weight.amax(0)
    return Cameras(R, _translations(aligned, R, reference), K)


def _translations(aligned: AlignedMotions, R: Tensor, reference: int) -> Tensor:
    """(M, 3) robust mean over frames of ``root_j - R_j root_reference``."""
    path = aligned.root[reference]
    shift = aligned.root - torch.einsum("mij,nj->mni", R, path)
    share = aligned.weight * aligned.weight[reference]
    rows = []
    for v in range(len(R)):
        usable = share[v].cpu().numpy()
        if not (usable > 0).any():
            usable = np.ones_like(usable)
        rows.append(mean_vector(shift[v].cpu().numpy(), usable, scale=PATH_SCALE_M))
    t = torch.as_tensor(np.stack(rows)).to(R)
    t[reference] = 0.0
    return t

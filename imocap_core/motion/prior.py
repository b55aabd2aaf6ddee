"""The pose prior: a Gaussian mixture over articulation, and typical speeds of joints.

Fitted to real motion by ``tools/make_pose_prior.py``; the packaged file has the mixture and the
per-joint spreads only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from importlib.resources import as_file, files

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from imocap_core.conventions import SMPL_JOINTS

_LEG_RAD = 0.35  # spread of legs that nobody sees about straight ones
_HIDDEN, _FAINT = 0.7, 0.3  # of the frames; of the largest weight of a frame's keypoints


@dataclass(frozen=True)
class PosePrior:
    """A mixture of C Gaussians over the 69 axis-angle numbers of joints 1 to 23.

    Attributes:
        mean: (C, 69) radians; precision: (C, 69, 69); cholesky: (C, 69, 69) of the covariance.
        whitening: (69, C * 69) all components' whitening side by side: one product for all;
            whitened_mean: (C * 69).
        constant: (C,) each component's constant in twice the negative log likelihood, shifted so
            that the smallest is 0.
        weight: (C,) mixture weights.
        velocity_rad, acceleration_rad: (24,) RMS first and second differences of each joint's
            rotation at 30 frames/s, per frame and per frame^2.
    """

    mean: Float[Tensor, "C 69"]
    precision: Float[Tensor, "C 69 69"]
    cholesky: Float[Tensor, "C 69 69"]
    whitening: Float[Tensor, "69 C69"]
    whitened_mean: Float[Tensor, " C69"]
    constant: Float[Tensor, " C"]
    weight: Float[Tensor, " C"]
    velocity_rad: Float[Tensor, "24"]
    acceleration_rad: Float[Tensor, "24"]

    def best(
        self, theta: Float[Tensor, "*frames 69"]
    ) -> tuple[Float[Tensor, "*frames"], Int[Tensor, "*frames"]]:
        """Twice the negative log likelihood under the best component, and the component's index.

        Args:
            theta: radians.

        Returns:
            Cost, at least 0, and component.
        """
        whitened = (theta @ self.whitening).sub_(self.whitened_mean).unflatten(-1, self.mean.shape)
        smallest = (whitened.square_().sum(-1) + self.constant).min(-1)
        return smallest.values, smallest.indices

    def for_keypoints(
        self, names: Sequence[str], weights: Sequence[Float[np.ndarray, "_ K"]]
    ) -> PosePrior:
        """That of hidden legs where keypoints hardly ever show one; else itself.

        Args:
            weights: of the keypoints of each motion, 0 where missing.
        """
        legs = [any(x in name for x in ("knee", "ankle", "heel", "foot", "toe")) for name in names]
        weight = np.concatenate(weights)
        weight = weight[weight.max(axis=1) > 0]
        hidden = weight[:, legs].max(axis=1, initial=0.0) <= _FAINT * weight.max(axis=1)
        return self.of_hidden_legs if hidden.sum() > _HIDDEN * len(hidden) else self

    @cached_property
    def of_hidden_legs(self) -> PosePrior:
        """Legs stand, whatever the rest does: of what is hidden a max-mixture takes the narrowest
        component, not the likeliest, and that kneels."""
        parts = self.mean, self.weight, self.velocity_rad, self.acceleration_rad
        mean, weight, velocity, acceleration = (x.cpu().numpy().copy() for x in parts)
        covariance = (self.cholesky @ self.cholesky.mT).cpu().numpy()
        ends = ("hip", "knee", "ankle", "foot")
        legs = np.flatnonzero(np.repeat([name.endswith(ends) for name in SMPL_JOINTS[1:]], 3))
        mean[:, legs], covariance[:, legs], covariance[:, :, legs] = 0.0, 0.0, 0.0
        covariance[:, legs, legs] = _LEG_RAD**2
        place = self.mean.device, self.mean.dtype
        return mixture(mean, covariance, weight, velocity, acceleration, *place)

    def sample(
        self, count: int, rng: np.random.Generator, spread: float = 1.0
    ) -> Float[np.ndarray, "S 69"]:
        """``count`` poses drawn from the mixture, deviations scaled by ``spread``; radians."""
        weight = self.weight.cpu().numpy().astype(float)
        component = rng.choice(len(weight), size=count, p=weight / weight.sum())
        noise = rng.standard_normal((count, self.mean.shape[1]))
        deviation = np.empty_like(noise)
        for c, cholesky in enumerate(self.cholesky.cpu().numpy()):
            deviation[component == c] = noise[component == c] @ cholesky.T
        sampled: np.ndarray = self.mean.cpu().numpy()[component] + spread * deviation
        return sampled


def mixture(
    mean: Float[np.ndarray, "C 69"],
    covariance: Float[np.ndarray, "C 69 69"],
    weight: Float[np.ndarray, " C"],
    velocity_rad: Float[np.ndarray, "24"],
    acceleration_rad: Float[np.ndarray, "24"],
    device: str | torch.device = "cpu",
    dtype: torch.dtype = torch.float64,
) -> PosePrior:
    """A prior from its moments, radians."""
    constant = np.linalg.slogdet(covariance)[1] - 2 * np.log(weight)
    precision = np.linalg.inv(covariance)
    whitening = np.linalg.cholesky(precision)

    def tensor(x: np.ndarray) -> Tensor:
        return torch.as_tensor(np.asarray(x, float), device=device, dtype=dtype)

    return PosePrior(
        mean=tensor(mean),
        precision=tensor(precision),
        cholesky=tensor(np.linalg.cholesky(covariance)),
        whitening=tensor(np.concatenate([*whitening], axis=1)),
        whitened_mean=tensor(np.einsum("cn,cnm->cm", mean, whitening).ravel()),
        constant=tensor(constant - constant.min()),
        weight=tensor(weight),
        velocity_rad=tensor(velocity_rad),
        acceleration_rad=tensor(acceleration_rad),
    )


@lru_cache(maxsize=4)
def load_pose_prior(device: str | torch.device = "cpu") -> PosePrior:
    """The packaged prior (data/pose_prior.npz)."""
    parts = ("mean", "covariance", "weight", "velocity_rad", "acceleration_rad")
    with (
        as_file(files("imocap_core.motion") / "data" / "pose_prior.npz") as path,
        np.load(path) as stored,
    ):
        mean, covariance, weight, *paces = (np.asarray(stored[name]) for name in parts)
        return mixture(mean, covariance, weight, paces[0], paces[1], device)

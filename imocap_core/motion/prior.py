"""The pose prior: a Gaussian mixture over articulation, and how fast joints accelerate.

Fitted to real motion by ``tools/make_pose_prior.py``; the packaged file holds the mixture and the
per-joint spreads only.
"""

from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import as_file, files

import numpy as np
import torch
from torch import Tensor


@dataclass(frozen=True)
class PosePrior:
    """A mixture of C Gaussians over the 69 axis-angle numbers of joints 1 to 23.

    Attributes:
        mean: (C, 69) radians; precision: (C, 69, 69); cholesky: (C, 69, 69) of the covariance.
        constant: (C,) what each component adds to twice the negative log likelihood, shifted so
            that the smallest is 0.
        weight: (C,) mixture weights.
        velocity_rad, acceleration_rad: (24,) RMS first and second differences of each joint's
            rotation at 30 frames/s, per frame and per frame^2.
    """

    mean: Tensor
    precision: Tensor
    cholesky: Tensor
    constant: Tensor
    weight: Tensor
    velocity_rad: Tensor
    acceleration_rad: Tensor

    def best(self, theta: Tensor) -> tuple[Tensor, Tensor]:
        """Twice the negative log likelihood under the best component, and which one it is.

        Args:
            theta: (..., 69) radians.

        Returns:
            (...) cost, at least 0, and (...) int component.
        """
        offset = theta[..., None, :] - self.mean
        whitened = torch.einsum("...cn,cnm->...cm", offset, self.precision)
        distance = (whitened * offset).sum(-1) + self.constant
        smallest = distance.min(-1)
        return smallest.values, smallest.indices

    def sample(self, count: int, rng: np.random.Generator, spread: float = 1.0) -> np.ndarray:
        """``count`` poses (count, 69) drawn from the mixture, deviations scaled by ``spread``."""
        weight = self.weight.cpu().numpy().astype(float)
        component = rng.choice(len(weight), size=count, p=weight / weight.sum())
        noise = rng.standard_normal((count, self.mean.shape[1]))
        cholesky = self.cholesky.cpu().numpy()[component]
        deviation = np.einsum("cij,cj->ci", cholesky, noise)
        sampled: np.ndarray = self.mean.cpu().numpy()[component] + spread * deviation
        return sampled


def mixture(
    mean: np.ndarray,
    covariance: np.ndarray,
    weight: np.ndarray,
    velocity_rad: np.ndarray,
    acceleration_rad: np.ndarray,
    device: str | torch.device = "cpu",
    dtype: torch.dtype = torch.float64,
) -> PosePrior:
    """A prior from its moments: (C, 69), (C, 69, 69), (C,), (24,), (24,)."""
    constant = np.linalg.slogdet(covariance)[1] - 2 * np.log(weight)

    def tensor(x: np.ndarray) -> Tensor:
        return torch.as_tensor(np.asarray(x, float), device=device, dtype=dtype)

    return PosePrior(
        mean=tensor(mean),
        precision=tensor(np.linalg.inv(covariance)),
        cholesky=tensor(np.linalg.cholesky(covariance)),
        constant=tensor(constant - constant.min()),
        weight=tensor(weight),
        velocity_rad=tensor(velocity_rad),
        acceleration_rad=tensor(acceleration_rad),
    )


@lru_cache(maxsize=4)
def load_pose_prior(
    device: str | torch.device = "cpu", dtype: torch.dtype = torch.float64
) -> PosePrior:
    """The packaged prior (data/pose_prior.npz)."""
    with (
        as_file(files("imocap_core.motion") / "data" / "pose_prior.npz") as path,
        np.load(path) as stored,
    ):
        fields = {name: stored[name] for name in stored.files}
    return mixture(
        **{
            k: fields[k]
            for k in ("mean", "covariance", "weight", "velocity_rad", "acceleration_rad")
        },
        device=device,
        dtype=dtype,
    )

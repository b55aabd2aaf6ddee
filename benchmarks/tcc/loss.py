"""The cycle-back regression loss with variance (Dwibedi et al. 2019, section 3.2, "cycle-back
regression").

A frame u_i of one clip looks for its soft nearest neighbour in another clip,
    alpha_j = softmax_j(-|u_i - v_j|^2 / (D tau)),    v~ = sum_j alpha_j v_j,
which looks back into the first clip,
    beta_k = softmax_k(-|v~ - u_k|^2 / (D tau)),
and should find the moment it left from: with the times t of the first clip's frames,
    mu_i = sum_k beta_k t_k,    sigma_i^2 = sum_k beta_k (t_k - mu_i)^2,
    loss_i = (t_i - mu_i)^2 / sigma_i^2 + lambda log sigma_i.
"""

from torch import Tensor

LEAST_VARIANCE = 1e-6
"""Of times in [0, 1]: a thousandth of the clip; keeps a certain answer from an infinite loss."""


def squared_distances(u: Tensor, v: Tensor) -> Tensor:
    """|u_i - v_j|^2 (..., N, M) of embeddings (..., N, D) and (..., M, D)."""
    cross = u @ v.transpose(-1, -2)
    squares = (u * u).sum(-1)[..., :, None] + (v * v).sum(-1)[..., None, :] - 2.0 * cross
    return squares.clamp(min=0.0)


def soft_matches(u: Tensor, v: Tensor, temperature: float) -> Tensor:
    """alpha (..., N, M): where each frame of u (..., N, D) sees itself in v; rows sum to 1."""
    return (-squared_distances(u, v) / (u.shape[-1] * temperature)).softmax(dim=-1)


def cycle_back_regression(
    u: Tensor, v: Tensor, times: Tensor, *, temperature: float, variance_weight: float
) -> Tensor:
    """Mean loss over pairs and frames: a scalar.

    `u` (P, N, D) and `v` (P, M, D): embeddings of P pairs of clips, sampled in order of time;
    `times` (P, N): when u's frames are, in [0, 1] of their clip.
    """
    neighbour = soft_matches(u, v, temperature) @ v
    back = soft_matches(neighbour, u, temperature)
    mean = (back * times[:, None, :]).sum(-1)
    variance = (back * (times[:, None, :] - mean[..., None]) ** 2).sum(-1)
    variance = variance.clamp(min=LEAST_VARIANCE)
    return ((times - mean) ** 2 / variance + 0.5 * variance_weight * variance.log()).mean()

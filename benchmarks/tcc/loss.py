"""The cycle-back regression loss with variance (Dwibedi et al. 2019, section 3.2, "cycle-back
regression").

A frame u_i of one clip looks for its soft nearest neighbour in another clip,
    alpha_j = softmax_j(-|u_i - v_j|^2 / (D tau)),    v~ = sum_j alpha_j v_j,
which looks back into the first clip,
    beta_k = softmax_k(-|v~ - u_k|^2 / (D tau)),
and should return to the moment that it left from: with the times t of the first clip's frames,
    mu_i = sum_k beta_k t_k,    sigma_i^2 = sum_k beta_k (t_k - mu_i)^2,
    loss_i = (t_i - mu_i)^2 / sigma_i^2 + lambda log sigma_i.
"""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

LEAST_VARIANCE = 1e-6
"""Of times in [0, 1]: a standard deviation of a thousandth of the clip. It bounds the loss of a
certain match."""


def squared_distances(
    u: Float[Tensor, "... N D"], v: Float[Tensor, "... M D"]
) -> Float[Tensor, "... N M"]:
    """|u_i - v_j|^2 of embeddings."""
    cross = u @ v.transpose(-1, -2)
    squares = (u * u).sum(-1)[..., :, None] + (v * v).sum(-1)[..., None, :] - 2.0 * cross
    return squares.clamp(min=0.0)


def soft_matches(
    u: Float[Tensor, "... N D"], v: Float[Tensor, "... M D"], temperature: float
) -> Float[Tensor, "... N M"]:
    """alpha: the soft nearest neighbours in v of each frame of u; rows sum to 1."""
    return (-squared_distances(u, v) / (u.shape[-1] * temperature)).softmax(dim=-1)


def cycle_back_regression(
    u: Float[Tensor, "P N D"],
    v: Float[Tensor, "P M D"],
    times: Float[Tensor, "P N"],
    *,
    temperature: float,
    variance_weight: float,
) -> Float[Tensor, ""]:
    """Mean loss over pairs and frames.

    `u` and `v`: embeddings of P pairs of clips, sampled in order of time; `times`: those of u's
    frames, in [0, 1] of their clip.
    """
    neighbour = soft_matches(u, v, temperature) @ v
    back = soft_matches(neighbour, u, temperature)
    mean = (back * times[:, None, :]).sum(-1)
    variance = (back * (times[:, None, :] - mean[..., None]) ** 2).sum(-1)
    variance = variance.clamp(min=LEAST_VARIANCE)
    return ((times - mean) ** 2 / variance + 0.5 * variance_weight * variance.log()).mean()

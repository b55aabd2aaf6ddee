"""All monotone warps at once: where may a frame of one video lie in another, given that time runs
forward in both?

DTW gives the one cheapest path. With estimates as noisy as monocular ones the cheapest path chases
the noise; the mean over all paths, each weighted by its likelihood, doesn't. That mean is a
forward-backward pass over a hidden Markov chain whose states are positions in the other video and
whose steps are never negative. Every step forward is equally likely a priori, so over a long hold
(a still pose) the expected positions are evenly spaced, and the spread of a frame's distribution
says how sure its match is.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

WORST_FRAME = (
    25.0  # how much less likely than its best position a frame's worst one may be, in nats
)


def interpolated_squares(squares: Array, step_squares: Array, per_frame: int) -> Array:
    """Squared distances to positions between frames: (n, m) -> (n, (m - 1) * per_frame + 1).

    For a pose moving in a straight line between frames b and b + 1, exactly
    d^2(b + x) = (1 - x) d^2(b) + x d^2(b + 1) - x (1 - x) |step|^2, with `step_squares` (m - 1,)
    the squared distance between neighbouring frames.
    """
    m = squares.shape[1]
    out = np.empty((len(squares), (m - 1) * per_frame + 1))
    out[:, ::per_frame] = squares
    for k in range(1, per_frame):
        x = k / per_frame
        between = (1 - x) * squares[:, :-1] + x * squares[:, 1:] - x * (1 - x) * step_squares
        out[:, k::per_frame] = np.maximum(between, 0.0)
    return out


def _advance(state: Array, max_step: int | None) -> Array:
    """Sum of all states at most `max_step` behind."""
    total = np.cumsum(state)
    if max_step is not None and max_step + 1 < len(state):
        total[max_step + 1 :] -= total[: -max_step - 1].copy()
        np.maximum(total, 0.0, out=total)
    return total


def monotone_posterior(
    cost: Array, *, unmatched: float, max_step: int | None = None
) -> tuple[Array, Array]:
    """P(frame t lies at position s) over all monotone warps: (n, S), rows summing to 1, and
    P(matched) (n,).

    `cost` (n, S): minus the log likelihood of the match, up to a constant; `unmatched`: the same
    for a frame that has no counterpart, allowed only before the first and after the last position
    (inf = every frame has one). The warp may start and end anywhere. `max_step`: the farthest a
    frame may be from the one before, in positions.
    """
    n, S = cost.shape
    # A match chooses among positions and "unmatched" doesn't: charge the match the prior of one
    # step of a walk that fills S positions in n frames.
    cost = cost + np.log1p(S / n)
    base = np.minimum(cost.min(axis=1), unmatched)
    # No frame may rule a position out altogether: one bad pose would end every warp there.
    like = np.exp(np.maximum(base[:, None] - cost, -WORST_FRAME))
    like_un = np.exp(np.maximum(base - unmatched, -WORST_FRAME))
    # a warp leaves "before" near the first position and enters "after" near the last
    edge = max(1, int(np.ceil(2.0 * S / n)))
    entry, leave = np.zeros(S), np.zeros(S)
    entry[:edge], leave[-edge:] = 1.0, 1.0

    forward, before, after = np.empty((n, S)), np.empty(n), np.zeros(n)
    forward[0], before[0] = like[0], like_un[0]
    for t in range(n):
        if t:
            forward[t] = (_advance(forward[t - 1], max_step) + before[t - 1] * entry) * like[t]
            before[t] = before[t - 1] * like_un[t]
            after[t] = (after[t - 1] + forward[t - 1] @ leave) * like_un[t]
        scale = max(forward[t].max(), before[t], after[t])
        forward[t], before[t], after[t] = forward[t] / scale, before[t] / scale, after[t] / scale

    posterior, matched = np.empty((n, S)), np.empty(n)
    back, back_before, back_after = np.ones(S), 1.0, 1.0
    for t in range(n - 1, -1, -1):
        if t < n - 1:
            match, skip = back * like[t + 1], like_un[t + 1]
            back_before = entry @ match + back_before * skip
            back = _advance(match[::-1], max_step)[::-1] + leave * back_after * skip
            back_after = back_after * skip
            scale = max(back.max(), back_before, back_after)
            back, back_before, back_after = back / scale, back_before / scale, back_after / scale
        joint = forward[t] * back
        inside = joint.sum()
        outside = before[t] * back_before + after[t] * back_after
        posterior[t] = joint / inside if inside > 0 else 1.0 / S
        matched[t] = inside / (inside + outside) if inside + outside > 0 else 0.0
    return posterior, matched

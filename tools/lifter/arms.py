"""Where arms are and how they move: at the sides, on the hips, behind the head, on one object.

Places of wrists in the axes of the chest, the pelvis or the head (`anatomy.Goals`), drawn for many
performances at once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lifter.anatomy import CHEST, HEAD, MIDDLE, PELVIS

ARM_M = (0.261, 0.237)  # upper arm, forearm


@dataclass(frozen=True)
class Draw:
    """Random numbers of N performances."""

    rng: np.random.Generator
    count: int

    def u(self, low: float, high: float, *shape: int) -> np.ndarray:
        """Uniform."""
        return self.rng.uniform(low, high, (self.count, *shape))

    def n(self, mean: float, spread: float, *shape: int) -> np.ndarray:
        """Normal."""
        return self.rng.normal(mean, spread, (self.count, *shape))

    def both(self, low: float, high: float, apart: float = 0.12) -> np.ndarray:
        """(N, 2): of both sides, nearly the same."""
        return self.u(low, high, 1) + self.n(0.0, apart * (high - low), 2)

    def some(self, share: float) -> np.ndarray:
        """(N,) bool."""
        return self.rng.random(self.count) < share


Arms = dict[str, np.ndarray]


def mixed(which: np.ndarray, a: Arms, b: Arms) -> Arms:
    """Arms of a where `which` (N,) holds, else of b."""
    return {k: np.where(which.reshape(-1, *[1] * (a[k].ndim - 1)), a[k], b[k]) for k in a}


def reaching(
    d: Draw, hands: np.ndarray, axes: int, elbow: tuple[float, float, float] | None = None,
    swivel: float = 20.0, wrist: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Arms:  # fmt: skip
    point = np.full((d.count, 2, 3), np.nan)
    if elbow is not None:
        point[:] = np.array(elbow) + d.n(0.0, 0.15, 1, 3)
    turn = d.n(0.0, swivel, 1) + d.n(0.0, swivel / 4, 2)
    bent = np.array(wrist) + d.n(0.0, 1.0, 1, 3) * (20, 8, 12) + d.n(0.0, 1.0, 2, 3) * (8, 3, 5)
    return {"hands": hands, "axes": np.full((d.count, 2), axes), "elbow": point, "swivel": turn,
            "wrist": bent}  # fmt: skip


def raised(d: Draw, lift: np.ndarray, aside: np.ndarray, bend: np.ndarray, **options) -> Arms:
    """Arms lifted from hanging (0) to overhead (180) in a plane from ahead (0) to the side (90),
    elbows bent; all (N, 2) degrees."""
    lift, aside, bend = np.radians(lift), np.radians(aside), np.radians(bend)
    upper, fore = ARM_M
    far = np.sqrt(upper**2 + fore**2 + 2 * upper * fore * np.cos(bend))
    way = np.stack([np.sin(lift) * np.sin(aside), -np.cos(lift), np.sin(lift) * np.cos(aside)], -1)
    return reaching(d, far[..., None] * way, CHEST, **options)


def hanging(d: Draw) -> Arms:
    return raised(d, d.both(4, 18), d.both(20, 100), d.both(4, 30))


def forward(d: Draw) -> Arms:
    return raised(d, d.both(60, 130), d.both(-18, 25), d.both(2, 25))


def sideways(d: Draw) -> Arms:
    return raised(d, d.both(60, 115), d.both(60, 95), d.both(2, 30))


def overhead(d: Draw) -> Arms:
    return raised(d, d.both(145, 182), d.both(20, 110), d.both(2, 35))


def shouldered(d: Draw) -> Arms:
    """Hands beside the shoulders: before a press, or a bar behind or before the neck."""
    hands = np.stack([d.both(0.0, 0.16), d.both(-0.06, 0.12), d.both(-0.02, 0.2)], -1)
    return reaching(d, hands, CHEST, elbow=(0.5, -1.0, 0.2))


def on_hips(d: Draw) -> Arms:
    hands = np.stack([d.both(0.15, 0.2), d.both(0.02, 0.12), d.both(-0.04, 0.07)], -1)
    return reaching(d, hands, PELVIS, elbow=(1.0, 0.1, -0.35), swivel=12.0, wrist=(0, -10, -40))


def behind_head(d: Draw) -> Arms:
    hands = np.stack([d.both(0.05, 0.12), d.both(-0.02, 0.09), d.both(-0.14, -0.06)], -1)
    return reaching(d, hands, HEAD, elbow=(1.0, 0.25, 0.35), swivel=15.0, wrist=(0, -15, 20))


def at_head(d: Draw) -> Arms:
    hands = np.stack([d.both(0.1, 0.16), d.both(-0.05, 0.12), d.both(-0.04, 0.16)], -1)
    return reaching(d, hands, HEAD, elbow=(0.8, -0.6, 0.4))


def crossed(d: Draw) -> Arms:
    hands = np.stack([d.both(-0.2, -0.08), d.both(-0.14, 0.0), d.both(0.13, 0.2)], -1)
    return reaching(d, hands, CHEST, elbow=(0.4, -1.0, 0.3), swivel=12.0)


def guard(d: Draw) -> Arms:
    hands = np.stack([d.both(-0.15, 0.05), d.both(-0.1, 0.12), d.both(0.15, 0.33)], -1)
    return reaching(d, hands, CHEST, elbow=(0.3, -1.0, 0.0))


def curled(d: Draw) -> Arms:
    return raised(d, d.both(8, 60), d.both(0, 40), d.both(70, 140), elbow=(0.1, -0.3, -1.0))


def rowed(d: Draw) -> Arms:
    hands = np.stack([d.both(-0.02, 0.12), d.both(-0.3, -0.15), d.both(0.0, 0.2)], -1)
    return reaching(d, hands, CHEST, elbow=(0.4, 0.0, -1.0))


def on_thighs(d: Draw) -> Arms:
    hands = np.stack([d.both(0.08, 0.2), d.both(0.0, 0.16), d.both(0.2, 0.4)], -1)
    return reaching(d, hands, PELVIS)


def behind(d: Draw) -> Arms:
    hands = np.stack([d.both(0.02, 0.25), d.both(-0.05, 0.12), d.both(-0.3, -0.17)], -1)
    return reaching(d, hands, PELVIS, elbow=(1.0, 0.2, -0.6))


def one_object(d: Draw) -> Arms:
    """Both hands on one thing, before the chest, above, below or beside."""
    round_, up = np.radians(d.n(0, 40)), np.radians(d.u(-70, 80))
    far, half = d.u(0.22, 0.46), d.u(0.02, 0.17)
    slope, turn = d.n(0.0, 0.5), d.n(0.0, 0.4)
    middle = far[:, None] * np.stack(
        [np.sin(round_) * np.cos(up), np.sin(up), np.cos(round_) * np.cos(up)], -1
    )
    middle[:, 2] = np.maximum(middle[:, 2], 0.14)
    axis = np.stack([np.cos(slope) * np.cos(turn), np.sin(slope), np.sin(turn)], -1)
    hands = np.stack([middle + half[:, None] * axis, middle - half[:, None] * axis], 1)
    return reaching(d, hands, MIDDLE)


def anywhere(d: Draw) -> Arms:
    """Each arm by itself, where arms go: ahead rather than behind, low rather than high."""
    lift = 180 * d.rng.beta(1.6, 2.0, (d.count, 2))
    aside = np.clip(d.n(45, 45, 2), -50, 125)
    return raised(d, lift, aside, 130 * d.rng.beta(1.2, 1.8, (d.count, 2)), swivel=25.0)


HOLDS = (hanging, hanging, on_hips, behind_head, crossed, guard, shouldered, one_object, at_head,
         on_thighs, behind)  # fmt: skip
MOVES = ((hanging, forward), (hanging, sideways), (hanging, overhead), (hanging, curled),
         (shouldered, overhead), (shouldered, overhead), (forward, rowed), (forward, sideways),
         (sideways, overhead), (one_object, one_object), (anywhere, anywhere), (guard, forward),
         (crossed, overhead), (hanging, on_hips), (hanging, behind_head), (hanging, at_head),
         (sideways, sideways), (forward, overhead))  # fmt: skip


def any_of(d: Draw, kinds: tuple[Callable[[Draw], Arms], ...]) -> Arms:
    """One kind for each performance."""
    choice = d.rng.integers(len(kinds), size=d.count)
    arms = kinds[0](d)
    for k, kind in enumerate(kinds[1:], 1):
        arms = mixed(choice == k, kind(d), arms)
    return arms


def two_arms(d: Draw, holding: float = 0.4, free_side: float = 0.15) -> tuple[Arms, Arms]:
    """Arms at two keys: held, or moved from one place to another; sometimes one arm alone."""
    choice = d.rng.integers(len(MOVES), size=d.count)
    a, b = MOVES[0][0](d), MOVES[0][1](d)
    for k, (first, second) in enumerate(MOVES[1:], 1):
        a, b = mixed(choice == k, first(d), a), mixed(choice == k, second(d), b)
    held = any_of(d, HOLDS)
    hold = d.some(holding)
    a, b = mixed(hold, held, a), mixed(hold, held, b)
    one, left = d.some(free_side), d.some(0.5)
    for side, is_side in enumerate((left, ~left)):
        rows = one & is_side & (a["axes"][:, side] != MIDDLE) & ~hold
        for k in b:
            b[k][rows, side] = a[k][rows, side]
    return a, b

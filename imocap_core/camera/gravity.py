"""Direction of gravity: the posterior of up, from how cameras are held and how bodies stand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from imocap_core.camera.tilt_evidence import (
    LEAN_AHEAD,
    LevelPrior,
    Support,
    balance_cost,
    camera_angles_deg,
    camera_cost,
    carried_cost,
    hanging_cost,
    perpendicular,
    plane_cost,
    support_of,
    trunk_cost,
)

MOMENTS = 40  # of a video that are looked at
CORRELATION_S = 0.5  # errors of a pose persist: so long a time counts as one observation
MOST_OBSERVATIONS = 5.0  # and a video's common error remains, however long it is
WRONG_SHARE = 0.02  # of motions that lean to or from the camera as a whole
ROLLS_DEG, PITCHES_DEG = np.arange(-180.0, 181.0, 5.0), np.arange(-60.0, 61.0, 6.0)
OTHER_SHARE, HANGING_SHARE = 0.05, 0.01  # of videos in which other parts than feet carry the body
STANDING_COST = 4.5  # of balance and trunk for who stands: densities of a narrow and a wide support
BY_WHAT = (1 - OTHER_SHARE - HANGING_SHARE, OTHER_SHARE, HANGING_SHARE)
TRUNK_SHARE = 0.3  # of the evidence of balance, which speaks of nearly the same
SPHERE = 1000  # directions that are compared first, 7 degrees apart
REFINEMENTS, GRID, REACH_SD = 3, 17, 4.0
FIRST_REACH_DEG, LEAST_REACH_DEG, MOST_REACH_DEG = 12.0, 2.0, 30.0
APART_DEG, MOST_MODES, HOPELESS = 25.0, 3, 12.0  # of proposals: angle, number, cost above the least
CHUNK = 100  # directions evaluated together, so that their arrays stay in the processor's cache


@dataclass(frozen=True)
class FilmedBody:
    """One video's body in the axes of the world, and the mean of its camera's rotations.

    joints: SMPL's, metres; frames without all of them are left out.
    """

    joints: Float[np.ndarray, "T 24 3"]
    fps: float
    R_cam_from_world: Float[np.ndarray, "3 3"]


@dataclass(frozen=True)
class UpEstimate:
    """Mean of the posterior, a unit vector, and its standard deviation about a horizontal axis."""

    up: Float[np.ndarray, "3"]
    sd_deg: float


def estimate_up(bodies: Sequence[FilmedBody], prior: LevelPrior) -> UpEstimate:
    """Up in the axes of a world that some videos share; a video without a body has its camera.

    The posterior is summed over a grid of directions that closes in on its mean: with two unknowns
    that is exact, and several modes show in the standard deviation.
    """
    stances = [s for body in bodies if (s := _Stance.of(body)) is not None]

    def cost(up: Float[np.ndarray, "U 3"]) -> Float[np.ndarray, " U"]:
        total = np.zeros(len(up))
        for body in bodies:
            total += camera_cost(up, body.R_cam_from_world, prior)
        for stance in stances:
            total += stance.cost(up)
        return total

    return _searched(cost, [b.R_cam_from_world for b in bodies], prior)


Cost = Callable[[Float[np.ndarray, "U 3"]], Float[np.ndarray, " U"]]


def _searched(
    cost: Cost, cameras: Sequence[Float[np.ndarray, "3 3"]], prior: LevelPrior
) -> UpEstimate:
    """The likeliest of few ups, and its standard deviation.

    Proposed are cameras that are held level and the least costs on the sphere. The proposal with
    the most posterior around it is chosen, not their mean; how likely it is one of the others
    shows in the standard deviation.
    """
    level = _up_of_angles(np.zeros(1), np.array([prior.pitch_down_deg]))
    sphere = np.concatenate([*(level @ R for R in cameras), _fibonacci_sphere(SPHERE)])
    costs = cost(sphere)
    modes: list[_Mode] = []
    for k in costs.argsort():
        apart = [_angles_deg(sphere[k], m.start).item() for m in modes]
        if costs[k] > costs.min() + HOPELESS or len(modes) == MOST_MODES:
            break
        if min(apart, default=180.0) > APART_DEG:
            modes.append(_Mode.around(cost, sphere[k]))
    best = min(modes, key=lambda m: m.cost)
    share = np.exp(-0.5 * np.array([m.cost - best.cost for m in modes]))
    share /= share.sum()
    apart_deg = np.array([_angles_deg(best.mean, m.mean).item() for m in modes])
    spread = np.array([m.sd_deg for m in modes]) ** 2 + apart_deg**2 / 2
    return UpEstimate(best.mean, float(np.sqrt(share @ spread)))


@dataclass(frozen=True)
class _Mode:
    """The posterior around one direction: its mean, spread, -2 log of its integral."""

    start: Float[np.ndarray, "3"]
    mean: Float[np.ndarray, "3"]
    sd_deg: float
    cost: float

    @classmethod
    def around(cls, cost: Cost, start: Float[np.ndarray, "3"]) -> _Mode:
        """Sums over a grid that closes in on the mean."""
        mean, reach, sd, whole = start, FIRST_REACH_DEG, 0.0, 0.0
        for _ in range(REFINEMENTS):
            around = _grid(mean, reach)
            costs = cost(around)
            weight = np.exp(-0.5 * (costs - costs.min()))
            whole = float(costs.min() - 2 * np.log(weight.sum() * reach**2))
            weight /= weight.sum()
            mean = weight @ around
            mean /= np.linalg.norm(mean)
            sd = float(np.sqrt(weight @ _angles_deg(mean, around) ** 2 / 2))
            reach = float(np.clip(REACH_SD * sd, LEAST_REACH_DEG, MOST_REACH_DEG))
        return cls(start, mean, sd, whole)


def _angles_deg(a: Float[np.ndarray, "3"], b: Float[np.ndarray, "*U 3"]) -> Float[np.ndarray, "*U"]:
    return np.asarray(np.degrees(np.arccos(np.clip(b @ a, -1.0, 1.0))))


def _in_chunks(cost: Cost) -> Cost:
    """The same cost of few directions at a time, so that its arrays stay in the cache."""

    def of(up: Float[np.ndarray, "U 3"]) -> Float[np.ndarray, " U"]:
        return np.concatenate([cost(up[k : k + CHUNK]) for k in range(0, len(up), CHUNK)])

    return of


@dataclass(frozen=True)
class _Stance:
    """What one body tells: its support, its camera, how many independent observations it is worth,
    and its least cost over the pitch of the camera for each roll (of ROLLS_DEG)."""

    support: Support
    R_cam_from_world: Float[np.ndarray, "3 3"]
    count: float
    of_roll: Float[np.ndarray, " N"]

    @classmethod
    def of(cls, body: FilmedBody) -> _Stance | None:
        whole = np.isfinite(body.joints).all(axis=(1, 2))
        if not whole.any():
            return None
        count = min(float(whole.sum()) / body.fps / CORRELATION_S, MOST_OBSERVATIONS)
        support = support_of(body.joints[whole], body.fps, MOMENTS)
        stance = cls(support, body.R_cam_from_world, count, np.zeros(len(ROLLS_DEG)))
        roll, pitch = np.meshgrid(ROLLS_DEG, PITCHES_DEG, indexing="ij")
        up = _up_of_angles(roll.ravel(), pitch.ravel()) @ body.R_cam_from_world
        costs = _in_chunks(stance.if_right)(up)
        return replace(stance, of_roll=costs.reshape(roll.shape).min(axis=1))

    def if_right(self, up: Float[np.ndarray, "U 3"]) -> Float[np.ndarray, " U"]:
        """As if the pose were right: the body stands on its feet, upright more often than not; or,
        throughout a video, other parts carry it, and nothing is known of its trunk."""
        sight = self.R_cam_from_world[2]
        feet = balance_cost(up, self.support, sight) + plane_cost(up, self.support)
        feet += TRUNK_SHARE * trunk_cost(up, self.support) - STANDING_COST
        others = carried_cost(up, self.support, sight, LEAN_AHEAD)
        hands = hanging_cost(up, self.support, sight, LEAN_AHEAD)
        return _mixed(self.count * np.stack([feet, others, hands]), BY_WHAT)

    def cost(self, up: Float[np.ndarray, "U 3"]) -> Float[np.ndarray, " U"]:
        """The same when the whole motion may lean in depth, which a view shows least: then it tells
        the camera's roll alone."""
        roll, _ = camera_angles_deg(up, self.R_cam_from_world)
        wrong = np.interp(roll, ROLLS_DEG, self.of_roll)
        right = _in_chunks(self.if_right)(up)
        return _mixed(np.stack([right, wrong]), (1 - WRONG_SHARE, WRONG_SHARE))


def _mixed(costs: Float[np.ndarray, "C U"], shares: Sequence[float]) -> Float[np.ndarray, " U"]:
    """Cost of a mixture of cases that have these shares."""
    least = costs.min(axis=0)
    return np.asarray(least - 2 * np.log(np.asarray(shares) @ np.exp(-0.5 * (costs - least))))


def _up_of_angles(
    roll_deg: Float[np.ndarray, " U"], down_deg: Float[np.ndarray, " U"]
) -> Float[np.ndarray, "U 3"]:
    """Up in the axes of cameras of a roll and a downward pitch."""
    roll, down = np.radians(roll_deg), np.radians(down_deg)
    flat = np.cos(down)
    return np.stack([flat * np.sin(roll), -flat * np.cos(roll), -np.sin(down)], axis=1)


def _fibonacci_sphere(count: int) -> Float[np.ndarray, "U 3"]:
    """Directions spread evenly over the sphere."""
    index = np.arange(count) + 0.5
    z, turn = 1 - 2 * index / count, np.pi * (1 + 5**0.5) * index
    radius = np.sqrt(1 - z**2)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)


def _grid(centre: Float[np.ndarray, "3"], reach_deg: float) -> Float[np.ndarray, "U 3"]:
    """Directions around one, on a square grid in its tangent plane."""
    east, north = (axis[0] for axis in perpendicular(centre[None]))
    side = np.linspace(-1.0, 1.0, GRID) * np.tan(np.radians(reach_deg))
    x, y = (a.ravel()[:, None] for a in np.meshgrid(side, side))
    around = centre + x * east + y * north
    return np.asarray(around / np.linalg.norm(around, axis=1, keepdims=True))

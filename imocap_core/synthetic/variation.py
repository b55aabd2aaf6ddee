"""Performances: the same action by the same body, never twice the same.

Each performance has its own pace (a non-linear monotone map from frames to phase), its own small
departures from the choreography at every key, its own places for hands and feet, and starts and
ends at its own phase. Hands and feet are planted again afterwards, so the variation stays physical.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation, RotationSpline

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.render.arrays import Floats
from imocap_core.synthetic.contact import (
    Forward,
    Place,
    contact_targets,
    floor_plan,
    per_name,
    plant,
)
from imocap_core.synthetic.yoga import Key, local_rotations

PHASE_PER_S = 30.0  # phase counts frames of the choreography at its own pace

# world from stage: the stage's y (up) is the world's z, its x (performer's left) stays
R_WORLD_FROM_STAGE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])

# standard deviation in degrees by which a joint departs from the choreography, about (x, y, z)
_SPREAD_DEG = {"pelvis": (2, 2, 1.5), "spine1": (2, 1.5, 1.5), "spine2": (2, 1.5, 1.5)}
_SPREAD_DEG |= {"spine3": (2, 1.5, 1.5), "neck": (4, 4, 2), "head": (4, 4, 2)}
_SPREAD_DEG |= {"hip": (4, 3, 3), "knee": (5, 0, 0), "ankle": (4, 2, 2), "foot": (3, 0, 0)}
_SPREAD_DEG |= {"collar": (2, 3, 3), "shoulder": (6, 6, 6), "elbow": (5, 6, 0)}
_SPREAD_DEG |= {"wrist": (4, 4, 6), "hand": (0, 0, 0)}
_HIPS_SPREAD_M = 0.02
_PLACE_SPREAD_M = 0.025
_DRIFT_SPREAD_M = 0.05  # the feet come back to another spot than they left
_PACE_SPREAD = 0.22  # standard deviation of the log of the pace
_PACE_KNOT_S = 0.7
_SMOOTH_S = 0.05  # contact corrections are smoothed over this time


@dataclass(frozen=True)
class Performance:
    """One clip of motion in the world (z up, floor at z = 0, metres).

    phase (T,) strictly increasing, in frames of the choreography; R_local (T, 24, 3, 3);
    pelvis (T, 3).
    """

    phase: Floats
    R_local: Floats
    pelvis: Floats


@dataclass(frozen=True)
class Clip:
    """What is filmed: phases from `first` to `last` in `frames` frames."""

    frames: int
    first: float
    last: float
    fps: float


def perform(
    keys: Sequence[Key],
    clip: Clip,
    forward: Forward,
    joints_rest: Floats,
    sole_height: float,
    rng: np.random.Generator,
) -> Performance:
    """Perform the choreography once.

    forward: kinematics of the body; joints_rest (24, 3) and sole_height: its rest pose.
    """
    phase = pace(clip, rng)
    rotations, hips, varied = _vary(keys, rng)
    plan = _vary_plan(floor_plan(joints_rest, sole_height), rng)
    time_s = phase / PHASE_PER_S
    key_times = np.array([key.time_s for key in varied])
    at_keys = contact_targets(varied, plan, joints_rest, key_times)
    rotations, hips = plant(forward, rotations, hips, at_keys)

    guess = _between(key_times, rotations, time_s)
    hips_guess = PchipInterpolator(key_times, hips)(time_s)
    targets = contact_targets(varied, plan, joints_rest, time_s)
    R_local, pelvis = plant(forward, guess, hips_guess, targets)
    sigma = _SMOOTH_S * clip.fps
    R_local = guess @ _smooth_rotations(np.swapaxes(guess, -1, -2) @ R_local, sigma)
    pelvis = hips_guess + gaussian_filter1d(pelvis - hips_guess, sigma, axis=0, mode="nearest")
    R_local = R_local.copy()
    R_local[:, 0] = R_WORLD_FROM_STAGE @ R_local[:, 0]
    return Performance(phase, R_local, pelvis @ R_WORLD_FROM_STAGE.T)


def pace(clip: Clip, rng: np.random.Generator) -> Floats:
    """Phase (frames,) of every frame: strictly increasing from `clip.first` to `clip.last`.

    The log of the pace is a smooth random curve, a knot every _PACE_KNOT_S seconds.
    """
    knots = max(4, round(clip.frames / clip.fps / _PACE_KNOT_S) + 1)
    log_pace = rng.normal(0.0, _PACE_SPREAD, knots)
    curve = CubicSpline(np.linspace(0.0, 1.0, knots), log_pace, bc_type="natural")
    pace_at = np.exp(curve((np.arange(clip.frames - 1) + 0.5) / (clip.frames - 1)))
    progress = np.concatenate([[0.0], np.cumsum(pace_at)])
    return clip.first + (clip.last - clip.first) * progress / progress[-1]


def _vary(keys: Sequence[Key], rng: np.random.Generator) -> tuple[Floats, Floats, list[Key]]:
    """Local rotations (N, 24, 3, 3), hips (N, 3), and keys whose feet return to their own place.

    Half of the variance is the performance's style, the same at every key.
    """
    spread = np.deg2rad(per_name(_SPREAD_DEG, SMPL_JOINTS))
    style = rng.normal(size=spread.shape)
    moment = rng.normal(size=(len(keys), *spread.shape))
    departure = spread * (style + moment) / np.sqrt(2.0)
    authored = np.stack([local_rotations(key).as_matrix() for key in keys])
    turned = Rotation.from_rotvec(departure.reshape(-1, 3)).as_matrix().reshape(authored.shape)
    hips = np.array([[key.side_m, *key.hips_m] for key in keys])
    hips = hips + rng.normal(0.0, _HIPS_SPREAD_M, hips.shape)
    return authored @ turned, hips, _name_returns(keys)


def _name_returns(keys: Sequence[Key]) -> list[Key]:
    """Once a foot has been back, its front place is the place of its return."""
    been_back: set[str] = set()
    named = []
    for key in keys:
        for side in ("left", "right"):
            leg = getattr(key, side)
            if leg.place == "back":
                been_back.add(side)
            elif side in been_back:
                leg = replace(leg, place="return")
            key = replace(key, **{side: leg})
        named.append(key)
    return named


def _vary_plan(plan: dict[Place, Floats], rng: np.random.Generator) -> dict[Place, Floats]:
    level = np.array([1.0, 0.0, 1.0])  # places move on the floor only
    drift = rng.normal(0.0, _DRIFT_SPREAD_M, 3) * level
    return {
        place: centre
        + rng.normal(0.0, _PLACE_SPREAD_M, 3) * level
        + (drift if place[1] == "return" else 0.0)
        for place, centre in plan.items()
    }


def _between(key_times: Floats, rotations: Floats, time_s: Floats) -> Floats:
    """Each joint's rotations (N, 24, 3, 3) at key times, on a C2 spline of the rotation group."""
    splines = [
        RotationSpline(key_times, Rotation.from_matrix(rotations[:, joint]))
        for joint in range(rotations.shape[1])
    ]
    return np.stack([spline(time_s).as_matrix() for spline in splines], axis=1)


def _smooth_rotations(small: Floats, sigma_frames: float) -> Floats:
    """Gaussian smoothing over time of small rotations (T, J, 3, 3), through their logarithms."""
    vectors = Rotation.from_matrix(small.reshape(-1, 3, 3)).as_rotvec().reshape(len(small), -1)
    smooth = gaussian_filter1d(vectors, sigma_frames, axis=0, mode="nearest")
    return Rotation.from_rotvec(smooth.reshape(-1, 3)).as_matrix().reshape(small.shape)

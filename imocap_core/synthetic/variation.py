"""Random performances of one choreography by one body.

Performances vary in pace (a non-linear monotone map from frames to phase), in small departures from
the choreography at every key, in the places of hands and feet, and in the phases at which they
start and end. Contacts are solved again afterwards, so hands and feet do not slide or sink.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation, RotationSpline

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.synthetic.contact import (
    ContactPlace,
    Forward,
    contact_places,
    contact_targets,
    per_name,
    solve_contacts,
)
from imocap_core.synthetic.yoga import Key, local_rotations

PHASE_PER_S = 30.0  # phase counts frames of the choreography at its authored pace

# the choreography's y (up) is the world's z, its x (the performer's left) is the world's x
R_WORLD_FROM_CHOREOGRAPHY = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])

# standard deviation in degrees by which a joint departs from the choreography, about (x, y, z)
_SPREAD_DEG = {"pelvis": (2, 2, 1.5), "spine1": (2, 1.5, 1.5), "spine2": (2, 1.5, 1.5)}
_SPREAD_DEG |= {"spine3": (2, 1.5, 1.5), "neck": (4, 4, 2), "head": (4, 4, 2)}
_SPREAD_DEG |= {"hip": (4, 3, 3), "knee": (5, 0, 0), "ankle": (4, 2, 2), "foot": (3, 0, 0)}
_SPREAD_DEG |= {"collar": (2, 3, 3), "shoulder": (6, 6, 6), "elbow": (5, 6, 0)}
_SPREAD_DEG |= {"wrist": (4, 4, 6), "hand": (0, 0, 0)}
_HIPS_SPREAD_M = 0.02
_PLACE_SPREAD_M = 0.025
_DRIFT_SPREAD_M = 0.05  # of the place to which the feet return, from where they were
_PACE_SPREAD = 0.22  # standard deviation of the log of the pace
_PACE_KNOT_S = 0.7
_SMOOTH_S = 0.05  # contact corrections are smoothed over this time


@dataclass(frozen=True)
class SyntheticMotion:
    """One performance in the world (z up, floor at z = 0, metres).

    phase: strictly increasing, in frames of the choreography. R_local: joint rotations relative to
    the parent. pelvis: position.
    """

    phase: Float[np.ndarray, " T"]
    R_local: Float[np.ndarray, "T J 3 3"]
    pelvis: Float[np.ndarray, "T 3"]


@dataclass(frozen=True)
class PhaseSpan:
    """The filmed part of the choreography: phases from `first` to `last` in `frames` frames."""

    frames: int
    first: float
    last: float
    fps: float


def perform(
    keys: Sequence[Key],
    span: PhaseSpan,
    forward: Forward,
    joints_rest: Float[np.ndarray, "24 3"],
    sole_height: float,
    rng: np.random.Generator,
) -> SyntheticMotion:
    """One random performance of the choreography.

    Args:
        keys: the choreography. span: the filmed part of it.
        forward: kinematics of the body. joints_rest, sole_height: of its rest pose, metres.
    """
    phase = pace(span, rng)
    rotations, hips, varied = _vary(keys, rng)
    places = _vary_places(contact_places(joints_rest, sole_height), rng)
    time_s = phase / PHASE_PER_S
    key_times = np.array([key.time_s for key in varied])
    targets_at_keys = contact_targets(varied, places, joints_rest, key_times)
    rotations, hips = solve_contacts(forward, rotations, hips, targets_at_keys)

    guess = _interpolate(key_times, rotations, time_s)
    hips_guess = PchipInterpolator(key_times, hips)(time_s)
    targets = contact_targets(varied, places, joints_rest, time_s)
    R_local, pelvis = solve_contacts(forward, guess, hips_guess, targets)
    sigma = _SMOOTH_S * span.fps
    R_local = guess @ _smooth_rotations(np.swapaxes(guess, -1, -2) @ R_local, sigma)
    pelvis = hips_guess + gaussian_filter1d(pelvis - hips_guess, sigma, axis=0, mode="nearest")
    R_local = R_local.copy()
    R_local[:, 0] = R_WORLD_FROM_CHOREOGRAPHY @ R_local[:, 0]
    return SyntheticMotion(phase, R_local, pelvis @ R_WORLD_FROM_CHOREOGRAPHY.T)


def pace(span: PhaseSpan, rng: np.random.Generator) -> Float[np.ndarray, " T"]:
    """Phase of every frame: strictly increasing from `span.first` to `span.last`.

    The logarithm of the pace is a smooth random curve with a knot every _PACE_KNOT_S seconds.
    """
    knots = max(4, round(span.frames / span.fps / _PACE_KNOT_S) + 1)
    log_pace = rng.normal(0.0, _PACE_SPREAD, knots)
    curve = CubicSpline(np.linspace(0.0, 1.0, knots), log_pace, bc_type="natural")
    steps = np.exp(curve((np.arange(span.frames - 1) + 0.5) / (span.frames - 1)))
    progress = np.concatenate([[0.0], np.cumsum(steps)])
    return span.first + (span.last - span.first) * progress / progress[-1]


def _vary(
    keys: Sequence[Key], rng: np.random.Generator
) -> tuple[Float[np.ndarray, "N 24 3 3"], Float[np.ndarray, "N 3"], list[Key]]:
    """Local rotations and hip positions at the keys, and keys whose feet return elsewhere.

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
    """The keys, with the front place of a foot that has been back named "return"."""
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


def _vary_places(
    places: dict[ContactPlace, Float[np.ndarray, "3"]], rng: np.random.Generator
) -> dict[ContactPlace, Float[np.ndarray, "3"]]:
    horizontal = np.array([1.0, 0.0, 1.0])  # places move on the floor only
    drift = rng.normal(0.0, _DRIFT_SPREAD_M, 3) * horizontal
    return {
        place: centre
        + rng.normal(0.0, _PLACE_SPREAD_M, 3) * horizontal
        + (drift if place[1] == "return" else 0.0)
        for place, centre in places.items()
    }


def _interpolate(
    key_times: Float[np.ndarray, " N"],
    rotations: Float[np.ndarray, "N 24 3 3"],
    time_s: Float[np.ndarray, " T"],
) -> Float[np.ndarray, "T 24 3 3"]:
    """Each joint's rotations at key times, interpolated by a C2 spline on the rotation group."""
    splines = [
        RotationSpline(key_times, Rotation.from_matrix(rotations[:, joint]))
        for joint in range(rotations.shape[1])
    ]
    return np.stack([spline(time_s).as_matrix() for spline in splines], axis=1)


def _smooth_rotations(
    small: Float[np.ndarray, "T J 3 3"], sigma_frames: float
) -> Float[np.ndarray, "T J 3 3"]:
    """Gaussian smoothing over time of small rotations, through their logarithms."""
    vectors = Rotation.from_matrix(small.reshape(-1, 3, 3)).as_rotvec().reshape(len(small), -1)
    smooth = gaussian_filter1d(vectors, sigma_frames, axis=0, mode="nearest")
    return Rotation.from_rotvec(smooth.reshape(-1, 3)).as_matrix().reshape(small.shape)

"""Random performances of a choreography by one body, hands and feet at fixed places.

Contact constraints by inverse kinematics: hands and feet at fixed places on the floor. Keyframes
are authored by eye, so feet would slide and hands would sink. Every frame is therefore corrected by
a small least-squares problem: near the authored pose, joints in contact at their places, every
joint above the floor. All frames are solved at once and independently; inputs smooth in time give
outputs smooth in time. Axes of the choreography (y up, floor at y = 0), metres.

Performances vary in pace (a non-linear monotone map from frames to phase), in small departures from
the choreography at every key, in the places of hands and feet, and in the phases at which they
start and end. Contacts are solved again afterwards, so hands and feet do not slide or sink.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation, RotationSpline

from imocap_core.body import Shaped, keypoints_with_jacobian, make_points
from imocap_core.conventions import SIDES, SMPL_JOINTS, sideless
from imocap_core.synthetic.yoga import Key, local_rotations

# RGB by part of the body; the parts are those of the free body's faces
_PALETTE: dict[str, tuple[int, int, int]] = {
    "skin": (214, 165, 137),
    "hair": (58, 40, 30),
    "shirt": (196, 62, 58),
    "trousers": (44, 52, 84),
    "shoes": (232, 228, 220),
}


def contact_forward(shaped: Shaped) -> Forward:
    """Forward kinematics for contact.solve_contacts: numpy, pelvis position for translation.

    shaped: one body, coefficients (n,).
    """
    root = shaped.joints_rest[0]
    model = shaped.model
    joints = [{index: 1.0} for index in range(len(SMPL_JOINTS))]
    skin = [dict(model.landmarks[name]) for name in SKIN]
    nothing: dict[int, float] = {}
    points = make_points(
        model, POINTS, joints + [nothing] * len(skin), [nothing] * len(joints) + skin
    )

    def forward(
        R_local: Float[np.ndarray, "N 24 3 3"], pelvis: Float[np.ndarray, "N 3"]
    ) -> tuple[Float[np.ndarray, "N P 3"], Float[np.ndarray, "N P 3 72"]]:
        transl = torch.as_tensor(pelvis, dtype=root.dtype) - root
        rotations = torch.as_tensor(R_local, dtype=root.dtype)
        xyz, d_pose, _ = keypoints_with_jacobian(shaped, points, rotations, transl)
        return xyz.numpy(), d_pose.numpy()

    return forward


def outfit(
    face_parts: Int[np.ndarray, " F"], part_names: Sequence[str], rng: np.random.Generator
) -> Float[np.ndarray, "F 3"]:
    """RGB colour of every face: the palette, with randomly tinted clothes."""
    colors = np.array([_PALETTE[name] for name in part_names], dtype=np.float64)
    clothes = [i for i, name in enumerate(part_names) if name in ("shirt", "trousers", "shoes")]
    colors[clothes] = np.clip(colors[clothes] + rng.normal(0, 30, (len(clothes), 3)), 15, 245)
    return colors[face_parts]


# points of the skin that must stay above the floor, and their clearance
_SKIN_M = {"big_toe": 0.008, "small_toe": 0.008, "heel": 0.004}
_SKIN_M |= {"middle_tip": 0.008, "thumb_tip": 0.008, "index1": 0.015, "pinky1": 0.015}
SKIN: tuple[str, ...] = tuple(f"{side}_{name}" for side in SIDES for name in _SKIN_M)
POINTS: tuple[str, ...] = SMPL_JOINTS + SKIN

Forward = Callable[
    [Float[np.ndarray, "N 24 3 3"], Float[np.ndarray, "N 3"]],
    tuple[Float[np.ndarray, "N P 3"], Float[np.ndarray, "N P 3 72"]],
]
"""Forward kinematics: local rotations and pelvis to POINTS, and their derivatives by right local
increments of the rotations."""

ContactPlace = tuple[str, str]
"""(side, "front" | "back" | "return" | "hands" | "wide" | "forward")."""

_INDEX = {name: i for i, name in enumerate(SMPL_JOINTS)}
_HAND_REACH_M = 0.17  # hands are planted this far in front of the balls of the feet
_HAND_HALF_WIDTH_M = 0.19
_FOOT_HALF_WIDTH_M = 0.09
_STRIDE_M = 1.22  # from the planted wrists back to the balls of the rear feet
_WIDE_M = 0.15  # a wide stance, further out than a narrow one
_STEP_M = 0.38  # a step to the front
_STEP_LIFT_M = 0.10
_ROLL_LIFT_M = 0.07  # of a foot that rolls over its toes
_ROLL_DEG = 30.0
_FIRM = 1 / 0.003  # weight of a joint in contact: an error of 3 mm costs 1
_FLOOR = 1 / 0.004
_ITERATIONS = 16
_GENTLE = 8  # first iterations, in which weights increase, so that far targets cause no divergence
_GENTLE_DECADES = 2.0
_RAMP = 0.6  # share of the way to the next key in which a contact fades
_FADE_DECADES = 4.0  # decrease of its weight over this ramp, before it is 0

# distance of a joint centre from the skin below it, in contact poses
_CLEARANCE_M = {"pelvis": 0.10, "spine1": 0.11, "spine2": 0.12, "spine3": 0.13, "neck": 0.09}
_CLEARANCE_M |= {"head": 0.12, "hip": 0.09, "knee": 0.06, "shoulder": 0.08, "elbow": 0.05}
_CLEARANCE_M |= {"collar": 0.09, "ankle": 0.05, "foot": 0.02, "wrist": 0.06, "hand": 0.035}

# deviation in degrees about (x, y, z) from the authored rotation that costs 1
_GIVE_DEG = {"pelvis": (8, 4, 4), "spine1": (8, 4, 4), "spine2": (8, 4, 4), "spine3": (8, 4, 4)}
_GIVE_DEG |= {"hip": (25, 10, 10), "knee": (30, 3, 3), "ankle": (25, 8, 8), "foot": (20, 2, 2)}
_GIVE_DEG |= {"neck": (5, 3, 3), "head": (5, 3, 3), "collar": (6, 8, 8)}
_GIVE_DEG |= {
    "shoulder": (20, 25, 25),
    "elbow": (12, 25, 3),
    "wrist": (10, 12, 30),
    "hand": (1, 1, 1),
}
_GIVE_HIPS_M = (0.06, 0.20, 0.20)


def _per_name(table: Mapping[str, object], names: Sequence[str]) -> Float[np.ndarray, "N ..."]:
    """Rows of a table by names without their side."""
    return np.array([table[sideless(name)] for name in names], dtype=np.float64)


@dataclass(frozen=True)
class ContactTargets:
    """Target positions of points, with weights in 1/m; 0 where a point is free."""

    position: Float[np.ndarray, "N P 3"]
    weight: Float[np.ndarray, "N P 3"]


def contact_places(
    joints_rest: Float[np.ndarray, "24 3"], sole_height: float
) -> dict[ContactPlace, Float[np.ndarray, "3"]]:
    """Places of the balls of the feet and of the wrists for one body, as joint centres.

    joints_rest: rest joints, metres. sole_height: lowest point of the rest surface, metres.
    """
    plan: dict[ContactPlace, np.ndarray] = {}
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        ankle, ball = (joints_rest[_INDEX[f"{side}_{name}"]] for name in ("ankle", "foot"))
        height = ball[1] - sole_height
        length = np.hypot(*(ball - ankle)[[0, 2]])
        x = sign * _FOOT_HALF_WIDTH_M
        plan[side, "front"] = plan[side, "return"] = np.array([1.15 * x, height, 0.7 * length])
        reach = plan[side, "front"][2] + _HAND_REACH_M
        plan[side, "hands"] = np.array([sign * _HAND_HALF_WIDTH_M, _CLEARANCE_M["wrist"], reach])
        plan[side, "back"] = np.array([x, max(height, 0.03), reach - _STRIDE_M])
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        near = plan[side, "front"]
        plan[side, "wide"] = near + np.array([sign * _WIDE_M, 0.0, 0.0])
        plan[side, "forward"] = near + np.array([sign * 0.3 * _WIDE_M, 0.0, _STEP_M])
    return plan


def contact_targets(
    keys: Sequence[Key],
    plan: Mapping[ContactPlace, Float[np.ndarray, "3"]],
    joints_rest: Float[np.ndarray, "24 3"],
    time_s: Float[np.ndarray, " N"],
) -> ContactTargets:
    """Targets of all points at N times: feet in contact or stepping in an arc, palms on the floor.

    A foot between two places follows an arc; soles that are flat before and after stay flat;
    contacts that begin or end fade within the interval between two keys.
    """
    position, weight = (np.zeros((len(time_s), len(POINTS), 3)) for _ in range(2))
    key_times = np.array([key.time_s for key in keys])
    before = np.clip(np.searchsorted(key_times, time_s, side="right") - 1, 0, len(keys) - 2)
    share = (time_s - key_times[before]) / (key_times[before + 1] - key_times[before])
    share = np.clip(share, 0.0, 1.0)[:, None]
    for side in SIDES:
        ankle, ball, wrist, hand = (
            _INDEX[f"{side}_{n}"] for n in ("ankle", "foot", "wrist", "hand")
        )
        legs = [getattr(key, side) for key in keys]
        places = np.array([plan[side, leg.place] for leg in legs])
        start, end = places[before], places[before + 1]
        stepping = np.linalg.norm(end - start, axis=1, keepdims=True) > 1e-9
        toes = np.array([leg.toes for leg in legs])
        rolling = np.abs(toes[before + 1] - toes[before])[:, None] > _ROLL_DEG
        lift = np.where(stepping, _STEP_LIFT_M, _ROLL_LIFT_M * rolling)
        position[:, ball] = start + (end - start) * (share**2 * (3 - 2 * share))
        position[:, ball, 1:2] += lift * np.sin(np.pi * share) ** 2
        weight[:, ball] = _FIRM

        heel = joints_rest[ankle] - joints_rest[ball]
        flat_sole = np.array([np.sign(heel[0]) * 0.01, heel[1], -np.hypot(heel[0], heel[2])])
        position[:, ankle] = position[:, ball] + flat_sole
        flat = _fade(np.array([leg.flat for leg in legs], float), before, share)
        weight[:, ankle] = _FIRM * flat

        reach = np.linalg.norm(joints_rest[hand] - joints_rest[wrist])
        position[:, wrist] = plan[side, "hands"]
        lower = _CLEARANCE_M["hand"] - _CLEARANCE_M["wrist"]
        position[:, hand] = plan[side, "hands"] + np.array([0.0, lower, reach])
        planted = _fade(np.array([key.arms.planted for key in keys], float), before, share)
        weight[:, wrist] = _FIRM * planted
        weight[:, hand] = 0.3 * _FIRM * planted
    return ContactTargets(position, weight)


def _fade(
    on: Float[np.ndarray, " M"], before: Int[np.ndarray, " N"], share: Float[np.ndarray, "N 1"]
) -> Float[np.ndarray, "N 1"]:
    """Contact strength from its value (0 or 1) at the M keys.

    It fades by orders of magnitude, because the effect of a weight on a least-squares solution
    depends on its ratio to the other weights: a linear ramp would release the contact suddenly.
    """
    start, end = on[before][:, None], on[before + 1][:, None]
    leaving = start * _strength(share / _RAMP)
    arriving = end * _strength((1 - share) / _RAMP)
    return np.where((start > 0) & (end > 0), 1.0, leaving + arriving)


def _strength(faded: Float[np.ndarray, "N 1"]) -> Float[np.ndarray, "N 1"]:
    return np.where(faded < 1, 10 ** (-_FADE_DECADES * faded), 0.0)


def solve_contacts(
    forward: Forward,
    guess: Float[np.ndarray, "N 24 3 3"],
    hips: Float[np.ndarray, "N 3"],
    targets: ContactTargets,
) -> tuple[Float[np.ndarray, "N 24 3 3"], Float[np.ndarray, "N 3"]]:
    """Inverse kinematics: poses near the guess that meet their targets and stay above the floor.

    guess: local rotations. hips: pelvis positions. Returns both, corrected by a fixed number of
    Gauss-Newton steps with 75 unknowns per frame.
    """
    frames = len(guess)
    give = np.concatenate([np.deg2rad(_per_name(_GIVE_DEG, SMPL_JOINTS)).ravel(), _GIVE_HIPS_M])
    prior = np.diag(1.0 / give**2)
    clearance = _per_name(_CLEARANCE_M | _SKIN_M, POINTS)
    rotations, pelvis = guess, hips
    for iteration in range(_ITERATIONS):
        firmness = 10 ** (-_GENTLE_DECADES * max(0.0, 1 - iteration / _GENTLE))
        xyz, d_pose = forward(rotations, pelvis)
        by_hips = np.broadcast_to(np.eye(3), (*xyz.shape, 3))
        jacobian = np.concatenate([d_pose, by_hips], axis=-1)
        weight = targets.weight.copy()
        miss = weight * (xyz - targets.position)
        below = (xyz[..., 1] < clearance) & (weight[..., 1] == 0)
        weight[..., 1] += _FLOOR * below
        miss[..., 1] += _FLOOR * below * (xyz[..., 1] - clearance)
        weight, miss = firmness * weight, firmness * miss
        rows = (weight[..., None] * jacobian).reshape(frames, -1, len(give))
        moved = Rotation.from_matrix((np.swapaxes(guess, -1, -2) @ rotations).reshape(-1, 3, 3))
        away = np.concatenate([moved.as_rotvec().reshape(frames, -1), pelvis - hips], axis=1)
        gradient = np.einsum("nrk,nr->nk", rows, miss.reshape(frames, -1)) + away @ prior
        step = -np.linalg.solve(np.swapaxes(rows, 1, 2) @ rows + prior, gradient[..., None])[..., 0]
        turn = Rotation.from_rotvec(step[:, :-3].reshape(-1, 3)).as_matrix()
        rotations = rotations @ turn.reshape(guess.shape)
        pelvis = pelvis + step[:, -3:]
    return rotations, pelvis


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

    splines = [  # C2 on the rotation group
        RotationSpline(key_times, Rotation.from_matrix(rotations[:, joint]))
        for joint in range(rotations.shape[1])
    ]
    guess = np.stack([spline(time_s).as_matrix() for spline in splines], axis=1)
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
    spread = np.deg2rad(_per_name(_SPREAD_DEG, SMPL_JOINTS))
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


def _smooth_rotations(
    small: Float[np.ndarray, "T J 3 3"], sigma_frames: float
) -> Float[np.ndarray, "T J 3 3"]:
    """Gaussian smoothing over time of small rotations, through their logarithms."""
    vectors = Rotation.from_matrix(small.reshape(-1, 3, 3)).as_rotvec().reshape(len(small), -1)
    smooth = gaussian_filter1d(vectors, sigma_frames, axis=0, mode="nearest")
    return Rotation.from_rotvec(smooth.reshape(-1, 3)).as_matrix().reshape(small.shape)

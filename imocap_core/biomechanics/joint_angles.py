"""Joint angles by ISB's recommendations, in degrees, their standard deviations and mean curve.

Rotations as three angles about the axes of a joint coordinate system. Grood & Suntay (J. Biomech.
Eng. 105:136-144, 1983): the first axis is fixed to the proximal segment, the third to the distal
one, the second floats. All angles are in radians.

Wu et al. 2002 (hip, ankle, spine), Grood & Suntay 1983 (knee), Wu et al. 2005 (shoulder, elbow,
wrist); pelvis in the world after Baker 2001. Signs are those that clinicians use, the same on both
sides: flexion, adduction, internal rotation, dorsiflexion, inversion, pronation and ulnar deviation
are positive (`MEANING`).

How the rotations of the anatomical joints follow increments of the body model's. A segment is
turned by one of SMPL's joints, and those between it and its proximal neighbour carry it along. The
forearm is turned by the elbow and the twist of the wrist (`segments`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from imocap_core.biomechanics.segments import (
    MIRROR,
    SEGMENTS,
    anatomical_axes,
    forearm_axis,
    joint_index,
    segment_rest_axes,
    turn_about,
    twist_about,
    twist_gradient,
)
from imocap_core.conventions import SIDES, SMPL_JOINTS, SMPL_PARENTS, Side, mirror_indices

Angles = Float[np.ndarray, "T 3"]
Y = np.array([0.0, 1.0, 0.0])
LEAST_ELEVATION = np.radians(5.0)  # below it, or this near to 180 degrees, there is no plane


def zxy(R: Float[np.ndarray, "T 3 3"]) -> Angles:
    """Angles a, b, c of R = Rz(a) Rx(b) Ry(c): flexion, abduction, axial rotation."""
    b = np.arcsin(np.clip(R[:, 2, 1], -1, 1))
    a = np.arctan2(-R[:, 0, 1], R[:, 1, 1])
    c = np.arctan2(-R[:, 2, 0], R[:, 2, 2])
    return np.stack([a, b, c], axis=1)


def yxz(R: Float[np.ndarray, "T 3 3"]) -> Angles:
    """Angles a, b, c of R = Ry(a) Rx(b) Rz(c): rotation, obliquity, tilt (Baker, Gait &
    Posture 13:1-6, 2001)."""
    b = np.arcsin(np.clip(-R[:, 1, 2], -1, 1))
    a = np.arctan2(R[:, 0, 2], R[:, 2, 2])
    c = np.arctan2(R[:, 1, 0], R[:, 1, 1])
    return np.stack([a, b, c], axis=1)


def yxy(R: Float[np.ndarray, "T 3 3"]) -> Angles:
    """Plane of elevation, elevation (0 to pi) and axial rotation of R = Ry(p) Rx(-e) Ry(r).

    Plane and axial rotation are NaN where the elevation is too near to 0 or pi to tell them apart.
    """
    plane, elevation, rotation = yxy_everywhere(R).T
    together = np.minimum(elevation, np.pi - elevation) < LEAST_ELEVATION
    plane, rotation = (np.where(together, np.nan, angle) for angle in (plane, rotation))
    return np.stack([plane, elevation, rotation], axis=1)


def yxy_everywhere(R: Float[np.ndarray, "T 3 3"]) -> Angles:
    """The same at every elevation: the three angles always give R, though near an elevation of 0
    or pi plane and axial rotation take from one another and may jump. At these the plane is 0."""
    elevation = np.arccos(np.clip(R[:, 1, 1], -1, 1))
    plane = np.where(np.sin(elevation) < 1e-6, 0.0, np.arctan2(-R[:, 0, 1], -R[:, 2, 1]))
    raised = turn_about(Y, -plane) @ R  # Rx(-e) Ry(r)
    rotation = np.arctan2(raised[:, 0, 2], raised[:, 0, 0])
    return np.stack([plane, elevation, rotation], axis=1)


def continuous(angle: Float[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
    """An angle without jumps of a whole turn, its median within half a turn of 0; NaN stays."""
    out = np.array(angle)
    there = np.isfinite(out)
    if there.any():
        out[there] = np.unwrap(out[there])
        out -= 2 * np.pi * np.round(np.median(out[there]) / (2 * np.pi))
    return out


ZXY, YXY, YXZ = "zxy", "yxy", "yxz"
WORLD = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])  # X = z, Y = y, Z = -x
DECOMPOSITIONS = {ZXY: zxy, YXY: yxy, YXZ: yxz}


@dataclass(frozen=True)
class JointDefinition:
    """One joint: the segments on its sides, the order of its axes, and its three angles.

    angles: name and sign of each. proximal: None for the world.
    """

    proximal: str | None
    distal: str
    order: str
    angles: tuple[tuple[str, float], tuple[str, float], tuple[str, float]]


MIDDLE = {
    "pelvis": JointDefinition(
        None, "pelvis", YXZ, (("rotation", 1), ("obliquity", -1), ("tilt", -1))
    ),
    "trunk": JointDefinition(
        "pelvis", "thorax", ZXY, (("flexion", -1), ("right_bending", 1), ("left_rotation", 1))
    ),
    "neck": JointDefinition(
        "thorax", "head", ZXY, (("flexion", -1), ("right_bending", 1), ("left_rotation", 1))
    ),
}
PAIRED = {
    "hip": JointDefinition(
        "pelvis", "thigh", ZXY, (("flexion", 1), ("adduction", 1), ("internal_rotation", 1))
    ),
    "knee": JointDefinition(
        "thigh", "shank", ZXY, (("flexion", -1), ("adduction", 1), ("internal_rotation", 1))
    ),
    "ankle": JointDefinition(
        "shank", "foot", ZXY, (("dorsiflexion", 1), ("inversion", 1), ("internal_rotation", 1))
    ),
    "shoulder": JointDefinition(
        "thorax", "humerus", YXY, (("plane", 1), ("elevation", 1), ("internal_rotation", 1))
    ),
    "elbow": JointDefinition(
        "humerus", "forearm", ZXY, (("flexion", 1), ("adduction", 1), ("pronation", 1))
    ),
    "wrist": JointDefinition(
        "forearm", "hand", ZXY, (("flexion", 1), ("ulnar_deviation", 1), ("rotation", 1))
    ),
}
# What the model cannot tell: carrying angle and knee's varus are nearly constant in a person, and
# all of the twist below the elbow is pronation.
LEFT_OUT = ("wrist_rotation",)


ANATOMICAL_JOINTS = (*MIDDLE, *(f"{side}_{joint}" for joint in PAIRED for side in SIDES))


def definition_of(joint: str) -> tuple[Side, JointDefinition]:
    """Side and definition of one of `ANATOMICAL_JOINTS`; those of the middle are not mirrored."""
    for side in SIDES:
        if joint.startswith(f"{side}_"):
            return side, PAIRED[joint.removeprefix(f"{side}_")]
    return "right", MIDDLE[joint]


def angle_names() -> tuple[str, ...]:
    """The names of all angles: those of the middle, then `left_` and `right_` of each limb."""
    middle = [f"{j}_{name}" for j, of in MIDDLE.items() for name, _ in of.angles]
    limbs = [
        f"{side}_{j}_{name}"
        for j, of in PAIRED.items()
        for side in SIDES
        for name, _ in of.angles
        if f"{j}_{name}" not in LEFT_OUT
    ]
    return (*middle, *limbs)


def joint_angles_deg(
    R_local: Float[np.ndarray, "T 24 3 3"], rest_m: Float[np.ndarray, "24 3"]
) -> dict[str, Float[np.ndarray, " T"]]:
    """Every angle of `angle_names` over time, degrees, without jumps of a whole turn.

    Args:
        R_local: rotations of SMPL's joints against their parents, the first in a world whose y
            points up.
        rest_m: the joints of the rest pose, metres.
    """
    by_name = joint_angles_rad(R_local, rest_m, DECOMPOSITIONS)
    return {name: np.degrees(angle) for name, angle in by_name.items()}


def joint_angles_rad(
    R_local: Float[np.ndarray, "T 24 3 3"],
    rest_m: Float[np.ndarray, "24 3"],
    decompositions: Mapping[str, Callable[[np.ndarray], np.ndarray]],
) -> dict[str, Float[np.ndarray, " T"]]:
    """The same in radians, with rotations taken apart by other functions of the same orders."""
    by_name: dict[str, Float[np.ndarray, " T"]] = {}
    for side in SIDES:
        axes = anatomical_axes(R_local, rest_m, side)
        for joint, of in PAIRED.items():
            by_name |= _angles_of(f"{side}_{joint}", of, axes, decompositions)
        if side == "right":  # not mirrored
            for joint, of in MIDDLE.items():
                by_name |= _angles_of(joint, of, axes, decompositions)
    return {name: by_name[name] for name in angle_names()}


def distal_in_proximal(
    of: JointDefinition, axes: Mapping[str, Float[np.ndarray, "T 3 3"]]
) -> Float[np.ndarray, "T 3 3"]:
    """Rotation of a joint: the distal segment's axes in those of the proximal one."""
    proximal = WORLD if of.proximal is None else axes[of.proximal]
    return np.asarray(np.swapaxes(proximal, -1, -2) @ axes[of.distal])


def _angles_of(
    prefix: str,
    of: JointDefinition,
    axes: Mapping[str, Float[np.ndarray, "T 3 3"]],
    decompositions: Mapping[str, Callable[[np.ndarray], np.ndarray]],
) -> dict[str, Float[np.ndarray, " T"]]:
    angles = decompositions[of.order](distal_in_proximal(of, axes))
    return {
        f"{prefix}_{name}": continuous(sign * angles[:, i])
        for i, (name, sign) in enumerate(of.angles)
    }


TWINS = list(mirror_indices(ANATOMICAL_JOINTS))
PAIRED_FROM = 3  # pelvis, trunk and neck have no twin


def rotation_jacobian(
    R_local: Float[np.ndarray, "T 24 3 3"], rest_m: Float[np.ndarray, "24 3"]
) -> Float[np.ndarray, "T 15 3 72"]:
    """Derivatives of the rotations of `ANATOMICAL_JOINTS`, as vectors in the axes of the distal
    segment (right-handed on both sides), by increments R <- R exp(delta) of SMPL's joints.

    Args:
        R_local: rotations of SMPL's joints against their parents, the first in any axes.
        rest_m: the joints of the rest pose, metres.
    """
    rows = np.zeros((len(R_local), len(ANATOMICAL_JOINTS), 3, len(SMPL_JOINTS), 3))
    for k, joint in enumerate(ANATOMICAL_JOINTS):
        side, of = definition_of(joint)
        flip = MIRROR if side == "left" else np.eye(3)
        axes = segment_rest_axes(SEGMENTS[of.distal], rest_m @ flip, side)
        turned = axes.T @ flip * np.linalg.det(flip)
        rows[:, k] = np.einsum("xy,tyjz->txjz", turned, _by_increments(R_local, rest_m, side, of))
    return rows.reshape(*rows.shape[:3], -1)


def mirrored_rotation_covariance(
    covariance: Float[np.ndarray, "T 15 3 3"],
) -> Float[np.ndarray, "T 15 3 3"]:
    """Covariances of the joints' rotations in a mirror: of limbs their twins', whose axes are
    mirrored already; those of the middle turn the other way about X and Y."""
    swapped = np.array(covariance[:, TWINS])
    turn = np.array([-1.0, -1.0, 1.0])
    swapped[:, :PAIRED_FROM] *= turn[:, None] * turn
    return swapped


def _by_increments(
    R_local: Float[np.ndarray, "T 24 3 3"],
    rest_m: Float[np.ndarray, "24 3"],
    side: Side,
    of: JointDefinition,
) -> Float[np.ndarray, "T 3 24 3"]:
    """The derivatives of one joint, in the axes of the distal segment's joint of SMPL."""
    rows = np.zeros((len(R_local), 3, len(SMPL_JOINTS), 3))
    wrist, axis = joint_index("wrist", side), forearm_axis(rest_m, side)
    if of.proximal == "forearm":  # R = twist^T R_wrist
        carried = np.swapaxes(R_local[:, wrist], 1, 2) @ twist_about(R_local[:, wrist], axis)
        twisted = np.einsum("tx,ty->txy", carried @ axis, twist_gradient(R_local[:, wrist], axis))
        rows[:, :, wrist] = np.eye(3) - twisted
        return rows
    after = np.tile(np.eye(3), (len(R_local), 1, 1))  # what turns the segment after a joint
    if of.distal == "forearm":  # R = R_elbow twist
        after = twist_about(R_local[:, wrist], axis)
        rows[:, :, wrist] = axis[:, None] * twist_gradient(R_local[:, wrist], axis)[:, None]
    for joint in _chain(of, side):
        rows[:, :, joint] = np.swapaxes(after, 1, 2)
        after = R_local[:, joint] @ after
    return rows


def _chain(of: JointDefinition, side: Side) -> list[int]:
    """SMPL's joints that turn the distal segment against the proximal one, the last first."""
    joint = joint_index(SEGMENTS[of.distal].joint, side)
    end = -1 if of.proximal is None else joint_index(SEGMENTS[of.proximal].joint, side)
    chain = []
    while joint != end:
        chain.append(joint)
        joint = SMPL_PARENTS[joint]
    return chain


STEP_RAD = 1e-5
PELVIS = ANATOMICAL_JOINTS.index("pelvis")
BY_TILT = ("pelvis_obliquity", "pelvis_tilt")  # unknown where the world's tilt is


def angle_spreads_deg(
    R_local: Float[np.ndarray, "T 24 3 3"],
    rest_m: Float[np.ndarray, "24 3"],
    covariance_deg2: Float[np.ndarray, "T 15 3 3"],
    *,
    tilt_sd_deg: float,
    camera_sd_deg: float = 0.0,
) -> dict[str, Float[np.ndarray, " T"]]:
    """Standard deviation of every angle, degrees, to first order; by `angle_names`. NaN where an
    angle or its covariance is.

    Args:
        R_local, rest_m: as of `joint_angles_deg`.
        covariance_deg2: of the rotations of `ANATOMICAL_JOINTS`, as of `rotation_jacobian`.
        tilt_sd_deg: of the world's up about each horizontal axis; NaN unknown.
        camera_sd_deg: of the camera in the world, three axes together.
    """
    of_world = np.full(3, camera_sd_deg**2 / 3) + np.nan_to_num(tilt_sd_deg) ** 2 * np.array(
        [1.0, 0.0, 1.0]
    )
    by_side = {side: anatomical_axes(R_local, rest_m, side) for side in SIDES}
    sd: dict[str, Float[np.ndarray, " T"]] = {}
    for k, joint in enumerate(ANATOMICAL_JOINTS):
        side, of = definition_of(joint)
        R = distal_in_proximal(of, by_side[side])
        covariance = covariance_deg2[:, k]
        if k == PELVIS:
            level = WORLD @ R
            covariance = covariance + np.einsum("tyx,y,tyz->txz", level, of_world, level)
        gradient = _gradient(R, of.order)
        variance = np.einsum("tax,txy,tay->ta", gradient, covariance, gradient)
        for (name, _), of_angle in zip(of.angles, np.sqrt(variance).T, strict=True):
            sd[f"{joint}_{name}"] = of_angle
    if np.isnan(tilt_sd_deg):
        sd |= {name: np.full(len(R_local), np.nan) for name in BY_TILT}
    return {name: of_angle for name, of_angle in sd.items() if not name.endswith(LEFT_OUT)}


def _gradient(R: Float[np.ndarray, "T 3 3"], order: str) -> Float[np.ndarray, "T 3 3"]:
    """Derivatives of a rotation's three angles (rows) by increments R <- R exp(delta)."""
    columns = []
    for axis in np.eye(3):
        step = Rotation.from_rotvec(STEP_RAD * axis).as_matrix()
        ahead, behind = (DECOMPOSITIONS[order](R @ turn) for turn in (step, step.T))
        change = (ahead - behind + np.pi) % (2 * np.pi) - np.pi
        columns.append(change / (2 * STEP_RAD))
    return np.stack(columns, axis=-1)


TURN_DEG = 360.0


@dataclass(frozen=True, eq=False)
class MeanCurve:
    """An angle over N moments of the action.

    mean_deg, sd_deg (N,): over the performances that show the moment (n of them); NaN where none
    does, and the standard deviation where fewer than two do. What videos leave open of their
    performances is part of it where it is known (`mean_curve`).
    """

    mean_deg: Float[np.ndarray, " N"]
    sd_deg: Float[np.ndarray, " N"]
    n: Int[np.ndarray, " N"]


def mean_curve(
    curves_deg: Sequence[Float[np.ndarray, " N"]],
    inside: Sequence[Bool[np.ndarray, " N"]],
    open_sd_deg: Sequence[Float[np.ndarray, " N"]] = (),
) -> MeanCurve:
    """Mean of M curves at N common moments; each is moved by whole turns to lie near the first.

    The variance over performances has two parts (law of total variance): that of the solved curves,
    and what each video leaves open of its own performance. A fit draws performances together where
    a video says little, so that the first part alone is too small.

    inside: whether a performance shows the moment. open_sd_deg: the second part's root, of each
    curve; none: unknown.
    """
    values = np.stack([np.where(i, c, np.nan) for c, i in zip(curves_deg, inside, strict=True)])
    for k in range(1, len(values)):
        values[k] = near(values[k], values[0])
    there = np.isfinite(values)
    n = there.sum(axis=0)
    total = np.where(there, values, 0.0).sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(n > 0, total / n, np.nan)
        squares = np.where(there, (values - mean) ** 2, 0.0).sum(axis=0)
        variance = np.where(n > 1, squares / (n - 1), np.nan)
        if len(open_sd_deg):
            variance += np.where(there, np.stack(open_sd_deg) ** 2, 0.0).sum(axis=0) / n
    return MeanCurve(mean, np.sqrt(variance), n)


def near(
    curve_deg: Float[np.ndarray, " N"], reference_deg: Float[np.ndarray, " N"]
) -> Float[np.ndarray, " N"]:
    """A curve moved by whole turns to lie near a reference."""
    away = curve_deg - reference_deg
    if not np.isfinite(away).any():
        return curve_deg
    return np.asarray(curve_deg - TURN_DEG * np.round(np.nanmedian(away) / TURN_DEG))


def without_steps(curve: MeanCurve) -> Float[np.ndarray, " N"]:
    """The mean, NaN where a performance begins or ends: its step there is no movement."""
    changes = np.diff(curve.n, prepend=curve.n[:1]) != 0
    return np.where(changes, np.nan, curve.mean_deg)

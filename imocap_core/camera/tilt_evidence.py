"""Costs of directions as up: a held camera, a balanced body, an upright trunk, planted feet.

Each cost is twice a negative log likelihood up to a constant, with the heavy tails of Student's t,
because every rule here has exceptions (a tilted camera, a fall, a lying body, stairs). Directions
are candidates for up, (U, 3) unit vectors in the world's axes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import expit

from imocap_core.body.kinematics import centre_of_mass
from imocap_core.conventions import SIDES, SMPL_JOINTS

# degrees of freedom of the t distributions
ROLL_DOF, PITCH_DOF, BALANCE_DOF, TRUNK_DOF, PLANE_DOF = 2.0, 4.0, 4.0, 2.0, 3.0
SUPPORT_HEIGHT_M = 0.06  # a limb this far above the lowest one supports less
HAND_SHARE = 0.3  # of a foot's: how readily hands and knees count as support
SEAT_SHARE = 0.7  # of the weight of who sits
SEAT_S, SEAT_MOVED_M = 0.5, 0.06  # hips that rise and sink less in this time may rest on a seat
SEAT_HEIGHT, SEAT_SPREAD = 0.75, 0.05  # if lower than this share of a leg above the lowest limb
BACK_HEIGHT = 1.0  # of the upper back, which may lean on something
UNSEEN_M = 0.3  # error of the place of a limb that no video shows
SWAY_M = 0.06  # standard deviation of the centre of mass about the middle of its support
LEAN_ACROSS, LEAN_AHEAD = 0.04, 0.25  # the pose's errors across and along sight, of the height
DYNAMIC_S = 0.2  # and as a time at its speed: who moves need not balance
TRUNK_DEG = 8.0
RAISED_M = 0.4  # hands above the feet of whom they carry off the ground
PLANE_M = 0.08  # deviation of a planted foot's height and a hand's place, with errors of depth
PLANTED_M_S = 0.2  # speed at which a foot counts a quarter as planted
LEAST_PLANTED = 0.1  # feet that count less are left out
UNSEEN_SHARE = 0.01  # weight of an unseen foot: it tells the ground where no other does
PLANE_QUANTILE = 0.5

PELVIS, NECK = SMPL_JOINTS.index("pelvis"), SMPL_JOINTS.index("neck")
BALLS, ANKLES, WRISTS, KNEES, HIPS, SHOULDERS, ELBOWS = (
    [SMPL_JOINTS.index(f"{side}_{part}") for side in SIDES]
    for part in ("foot", "ankle", "wrist", "knee", "hip", "shoulder", "elbow")
)
LIMB_SHARES = np.concatenate(
    [
        0.5 * (np.eye(24)[ANKLES] + np.eye(24)[BALLS]),
        np.eye(24)[WRISTS + KNEES],
        np.stack([np.eye(24)[HIPS].mean(axis=0), np.eye(24)[SHOULDERS].mean(axis=0)]),
    ]
)
"""(8, 24) weights of SMPL's joints whose mean may support: feet, wrists, knees, the seat, the upper
back."""
LIMB_RADII_M = np.repeat([0.045, 0.05, 0.06], 2)[:, None]
"""Depths below the skin of those whose height tells whether they support."""
READILY = np.repeat([1.0, HAND_SHARE, HAND_SHARE], 2)[:, None]
"""How readily these count as support."""
SEAT_ALONE = np.array([[1.0], [0.0]])  # of what rests: not the upper back
PARTS = BALLS + ANKLES + WRISTS + KNEES + HIPS + [SMPL_JOINTS.index("head")] + SHOULDERS + ELBOWS
PART_RADII_M = np.repeat([0.03, 0.06, 0.05, 0.06, 0.1, 0.1, 0.08, 0.04], [2, 2, 2, 2, 2, 1, 2, 2])
"""Joints of parts that may carry a body which lies, kneels or stands on its hands, and their
depths below the skin, of the free body."""


@dataclass(frozen=True)
class LevelPrior:
    """How cameras are held: standard deviations of roll and pitch, and the mean pitch, degrees."""

    roll_deg: float
    pitch_deg: float
    pitch_down_deg: float


@dataclass(frozen=True)
class Support:
    """A body over what may support it, N moments.

    Attributes:
        centre: (N, 3) centre of mass; speed_m_s: (N,) its speed.
        limbs: (N, 8, 3) those of LIMB_SHARES; trunk: (N, 3) unit vectors from
            pelvis to neck.
        steps: (N, 2, 2, 3) of the seat and the upper back, to each moment and from it, `SEAT_S`
            each; leg_m: length of a leg.
        feet: (M, 3) balls of slow feet; planted: (M,) their weights.
        parts: (N, P, 3) those of PARTS; parts_m_s: (N, P) their speeds.
        limbs_unseen: (N, 8) 1 where it is not, 0 where it is seen.
    """

    centre: Float[np.ndarray, "N 3"]
    speed_m_s: Float[np.ndarray, " N"]
    limbs: Float[np.ndarray, "N 8 3"]
    trunk: Float[np.ndarray, "N 3"]
    steps: Float[np.ndarray, "N 2 2 3"]
    leg_m: float
    feet: Float[np.ndarray, "M 3"]
    planted: Float[np.ndarray, " M"]
    parts: Float[np.ndarray, "N P 3"]
    parts_m_s: Float[np.ndarray, "N P"]
    limbs_unseen: Float[np.ndarray, "N 8"]


def support_of(
    joints: Float[np.ndarray, "T 24 3"],
    fps: float,
    moments: int,
    shown: Float[np.ndarray, "T 24"] | None = None,
) -> Support:
    """Support at up to `moments` moments of a motion without gaps; shown: how far each joint is, 0
    to 1; None: all are."""
    shown = np.ones(joints.shape[:2]) if shown is None else shown
    centre = centre_of_mass(joints)
    parts = joints[:, PARTS]
    step, parts_step = (
        np.gradient(x, axis=0) if len(joints) > 1 else np.zeros_like(x) for x in (centre, parts)
    )
    index = np.unique(np.linspace(0, len(joints) - 1, moments).round().astype(np.int64))
    chosen = joints[index]
    trunk = chosen[:, NECK] - chosen[:, PELVIS]
    feet, planted = planted_feet(joints[:, BALLS], fps, shown[:, BALLS])
    some = np.unique(np.linspace(0, len(feet) - 1, 2 * moments).round().astype(np.int64))
    return Support(
        centre=centre[index],
        speed_m_s=fps * np.linalg.norm(step[index], axis=-1),
        limbs=np.einsum("sj,njc->nsc", LIMB_SHARES, chosen),
        trunk=trunk / np.maximum(np.linalg.norm(trunk, axis=-1, keepdims=True), 1e-9),
        steps=_steps(LIMB_SHARES[-2:] @ joints, round(SEAT_S * fps))[index],
        leg_m=_leg_m(joints),
        feet=feet[some],
        planted=planted[some],
        parts=parts[index],
        parts_m_s=fps * np.linalg.norm(parts_step[index], axis=-1),
        limbs_unseen=1 - shown[index] @ LIMB_SHARES.T,
    )


def _steps(places: Float[np.ndarray, "T 2 3"], frames: int) -> Float[np.ndarray, "T 2 2 3"]:
    """Movements of points over so many frames up to each, and from it on."""
    index = np.arange(len(places))
    before, after = (places[np.clip(index + k, 0, len(places) - 1)] for k in (-frames, frames))
    return np.stack([places - before, after - places], axis=2)


def _leg_m(joints: Float[np.ndarray, "T 24 3"]) -> float:
    """Mean length of thigh and shank together."""
    knees = joints[:, KNEES]
    parts = [joints[:, HIPS] - knees, knees - joints[:, ANKLES]]
    return float(sum(np.linalg.norm(part, axis=-1).mean() for part in parts))


def planted_feet(
    feet: Float[np.ndarray, "T 2 3"], fps: float, shown: Float[np.ndarray, "T 2"]
) -> tuple[Float[np.ndarray, "M 3"], Float[np.ndarray, " M"]]:
    """Places of slow feet, and weights by their speed and by how far they are shown; the slowest if
    none is slow."""
    shown = np.maximum(shown, UNSEEN_SHARE)
    if len(feet) == 1:
        return feet[0], shown[0]
    middle = (0.5 * (feet[1:] + feet[:-1])).reshape(-1, 3)
    speed = fps * np.linalg.norm(feet[1:] - feet[:-1], axis=-1).ravel()
    weight = planted_weight(speed) * shown[1:].ravel()
    slow = weight >= min(LEAST_PLANTED, weight.max())
    return middle[slow], weight[slow]


def planted_weight(speed_m_s: Float[np.ndarray, "*S"]) -> Float[np.ndarray, "*S"]:
    """1 for what stands still, a quarter at PLANTED_M_S."""
    return 1.0 / (1.0 + (speed_m_s / PLANTED_M_S) ** 2) ** 2


def camera_cost(
    up: Float[np.ndarray, "U 3"], R_cam_from_world: Float[np.ndarray, "3 3"], prior: LevelPrior
) -> Float[np.ndarray, " U"]:
    """Cameras are held without roll, and look down a little (x right, y down, z ahead)."""
    roll, down = camera_angles_deg(up, R_cam_from_world)
    return _student(roll / prior.roll_deg, ROLL_DOF) + _student(
        (down - prior.pitch_down_deg) / prior.pitch_deg, PITCH_DOF
    )


def camera_angles_deg(
    up: Float[np.ndarray, "U 3"], R_cam_from_world: Float[np.ndarray, "3 3"]
) -> tuple[Float[np.ndarray, " U"], Float[np.ndarray, " U"]]:
    """Roll (positive: up leans to the picture's right) and downward pitch of a camera."""
    x, y, z = (up @ R_cam_from_world.T).T
    roll, down = np.arctan2(x, -y), np.arctan2(-z, np.hypot(x, y))
    return np.degrees(roll), np.degrees(down)


def trunk_cost(up: Float[np.ndarray, "U 3"], support: Support) -> Float[np.ndarray, " U"]:
    """Trunks are upright more often than any other way; the mean over moments."""
    lean = np.degrees(np.arccos(np.clip(up @ support.trunk.T, -1.0, 1.0)))
    return np.asarray(_student(lean / TRUNK_DEG, TRUNK_DOF, dimensions=2).mean(axis=1))


def plane_cost(up: Float[np.ndarray, "U 3"], support: Support) -> Float[np.ndarray, " U"]:
    """Planted feet are on one height; the mean over feet."""
    height = up @ support.feet.T
    middle = weighted_quantile(height, support.planted, PLANE_QUANTILE)
    cost = _student((height - middle[:, None]) / PLANE_M, PLANE_DOF)
    return np.asarray(cost @ support.planted / support.planted.sum())


def balance_costs(
    up: Float[np.ndarray, "U 3"], support: Support, sight: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, " U"], Float[np.ndarray, " U"]]:
    """The centre of mass is above what stands on the ground and the seat; or, where a bench or a
    wall carries the upper back, above that as well. The mean over moments.

    Densities of the centre's place: narrow supports claim more of it than wide ones.
    """
    seated, rested = support_shares(up, support)
    return _density_cost(up, support, sight, seated), _density_cost(up, support, sight, rested)


def _density_cost(
    up: Float[np.ndarray, "U 3"],
    support: Support,
    sight: Float[np.ndarray, "3"],
    share: Float[np.ndarray, "U 8 N"],
) -> Float[np.ndarray, " U"]:
    """Of the centre of mass over limbs that carry it by their shares; the mean over moments. Limbs
    that nobody sees leave a variance to the middle of the support."""
    unseen = UNSEEN_M**2 * np.einsum("usn,ns->un", share**2, support.limbs_unseen)
    squared, determinant = _off_middle(up, support, support.limbs, share, sight, unseen)
    cost = _student(np.sqrt(squared), BALANCE_DOF, dimensions=2)
    return np.asarray((cost + np.log(determinant / SWAY_M**4)).mean(axis=1))


def carried_cost(
    up: Float[np.ndarray, "U 3"], support: Support, sight: Float[np.ndarray, "3"]
) -> Float[np.ndarray, " U"]:
    """The centre of mass is above the lowest parts, whichever they are, and these are on one height
    while they stand still; nothing is below it. The mean over moments."""
    height = np.einsum("npc,uc->upn", support.parts, up) - PART_RADII_M[:, None]
    share = _by_height(height)
    squared, _ = _off_middle(up, support, support.parts, share, sight)
    cost = _student(np.sqrt(squared), BALANCE_DOF, dimensions=2)
    return np.asarray(cost.mean(axis=1)) + _floor_cost(height, share, support.parts_m_s)


def _floor_cost(
    height: Float[np.ndarray, "U P N"],
    share: Float[np.ndarray, "U P N"],
    speed_m_s: Float[np.ndarray, "N P"],
) -> Float[np.ndarray, " U"]:
    """The lowest part is on one height while it stands still, and never below it."""
    lowest = height.min(axis=1)
    slow = (share * planted_weight(speed_m_s.T)).sum(axis=1)
    off = lowest - weighted_quantile(lowest, slow, PLANE_QUANTILE)[:, None]
    cost = _student(off / PLANE_M, PLANE_DOF)
    return np.asarray((cost * np.where(off < 0, 1.0, slow)).mean(axis=1))


def hands_cost(
    up: Float[np.ndarray, "U 3"], support: Support, sight: Float[np.ndarray, "3"]
) -> Float[np.ndarray, " U"]:
    """Hands that keep their places, well above the feet, carry the body together with feet as far
    as these stand still: from a bar, on bars, against a wall. The mean over moments."""
    limbs = support.limbs[:, :4]  # feet, hands
    feet = planted_weight(support.parts_m_s[:, : len(BALLS)])
    weight = np.hstack([feet, np.ones_like(feet)]).T
    share = np.broadcast_to(weight / weight.sum(axis=0), (len(up), *weight.shape))
    squared, _ = _off_middle(up, support, limbs, share, sight)
    above = up @ (limbs[:, 2:] - limbs[:, :2]).mean(axis=1).T
    moved = np.linalg.norm(limbs[:, 2:] - np.median(limbs[:, 2:], axis=0), axis=-1)
    cost = _student(np.sqrt(squared), BALANCE_DOF, dimensions=2)
    cost += _student(np.minimum(above - RAISED_M, 0.0) / PLANE_M, PLANE_DOF)
    return np.asarray(cost.mean(axis=1) + _student(moved / PLANE_M, PLANE_DOF).mean())


def _off_middle(
    up: Float[np.ndarray, "U 3"],
    support: Support,
    points: Float[np.ndarray, "N S 3"],
    share: Float[np.ndarray, "U S N"],
    sight: Float[np.ndarray, "3"],
    variance: float | Float[np.ndarray, "U N"] = 0.0,
) -> tuple[Float[np.ndarray, "U N"], Float[np.ndarray, "U N"]]:
    """Squared horizontal distance of the centre of mass from the middle of points that carry it, in
    standard deviations, and the determinant of their covariance, m^4.

    The distance is compared with the points' extent, the body's sway and the pose's errors: along
    the line of sight their size is a share of the centre's height; variance: of the middle, m^2.
    """
    axes = np.stack([up, *perpendicular(up)])  # (3, U, 3): up, and two horizontal directions
    moments, count, _ = points.shape
    placed = axes @ points.swapaxes(0, 1).reshape(-1, 3).T
    placed = placed.reshape(3, len(up), count, moments)  # along each axis
    middle = (share * placed).sum(axis=2)
    height, x, y = axes @ support.centre.T - middle  # (U, N) each
    apart_x, apart_y = placed[1:] - middle[1:, :, None]
    free = SWAY_M**2 + (LEAN_ACROSS * height) ** 2 + (DYNAMIC_S * support.speed_m_s) ** 2
    free += variance
    along = (LEAN_AHEAD**2 - LEAN_ACROSS**2) * height**2
    ahead_x, ahead_y = (axes[1:] @ sight)[..., None]
    weighted_x = share * apart_x
    a = 0.5 * (weighted_x * apart_x).sum(axis=1) + along * ahead_x**2 + free
    b = 0.5 * (weighted_x * apart_y).sum(axis=1) + along * ahead_x * ahead_y
    c = 0.5 * (share * apart_y * apart_y).sum(axis=1) + along * ahead_y**2 + free
    determinant = a * c - b**2
    return (c * x**2 - 2 * b * x * y + a * y**2) / determinant, determinant


def weighted_quantile(
    values: Float[np.ndarray, "U M"], weights: Float[np.ndarray, "*U M"], share: float
) -> Float[np.ndarray, " U"]:
    """Quantile of each row; weights of all rows, or of each."""
    order = np.argsort(values, axis=1)
    weights = np.take_along_axis(np.broadcast_to(weights, values.shape), order, axis=1)
    cumulated = np.cumsum(weights, axis=1)
    place = (cumulated >= share * cumulated[:, -1:]).argmax(axis=1)
    return np.asarray(np.take_along_axis(values, order, axis=1)[np.arange(len(values)), place])


def support_shares(
    up: Float[np.ndarray, "U 3"], support: Support
) -> tuple[Float[np.ndarray, "U 8 N"], Float[np.ndarray, "U 8 N"]]:
    """How much each limb and the seat support; and the same where the upper back may, too. Their
    sum is 1.

    Limbs count by their height above the lowest one. Seat and back rest on something, whose height
    nobody knows, where they are low and neither rise nor sink.
    """
    height = np.einsum("nsc,uc->usn", support.limbs, up)
    share = _by_height(height[:, :-2] - LIMB_RADII_M, READILY)
    lowest = height[:, :-2].min(axis=1, keepdims=True)
    above = (height[:, -2:] - lowest) / support.leg_m
    moved = np.abs(np.einsum("npkc,uc->kupn", support.steps, up)).max(axis=0)
    low = expit((np.array([[SEAT_HEIGHT], [BACK_HEIGHT]]) - above) / SEAT_SPREAD)
    rests = low / (1 + (moved / SEAT_MOVED_M) ** 2) ** 2
    return _with_rests(share, SEAT_ALONE * rests), _with_rests(share, rests)


def _with_rests(
    share: Float[np.ndarray, "U 6 N"], rests: Float[np.ndarray, "U 2 N"]
) -> Float[np.ndarray, "U 8 N"]:
    """Shares of limbs and of what rests on something, by how surely: as far as feet carry the
    others."""
    most = rests.max(axis=1, keepdims=True) / np.maximum(rests.sum(axis=1, keepdims=True), 1e-9)
    rest = SEAT_SHARE * rests * most * share[:, None, : len(BALLS)].sum(axis=2) ** 2
    return np.concatenate([(1 - rest.sum(axis=1))[:, None] * share, rest], axis=1)


def _by_height(
    height: Float[np.ndarray, "*any S N"], readily: float | Float[np.ndarray, "S 1"] = 1.0
) -> Float[np.ndarray, "*any S N"]:
    """Shares of points in the support by their height above the lowest one."""
    above = height - height.min(axis=-2, keepdims=True)
    share = readily * np.exp(-0.5 * (above / SUPPORT_HEIGHT_M) ** 2)
    return np.asarray(share / share.sum(axis=-2, keepdims=True))


def _student(
    ratio: Float[np.ndarray, "*S"], dof: float, dimensions: int = 1
) -> Float[np.ndarray, "*S"]:
    """Twice the negative log density of Student's t at ratios of its scale."""
    return (dof + dimensions) * np.log1p(ratio**2 / dof)


def perpendicular(
    up: Float[np.ndarray, "U 3"],
) -> tuple[Float[np.ndarray, "U 3"], Float[np.ndarray, "U 3"]]:
    """Two unit vectors perpendicular to each direction and to each other."""
    east = np.cross(up, np.eye(3)[np.abs(up).argmin(axis=1)])
    east /= np.linalg.norm(east, axis=1, keepdims=True)
    return east, np.cross(up, east)

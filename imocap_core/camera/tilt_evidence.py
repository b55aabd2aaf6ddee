"""Costs of directions as up: a held camera, a balanced body, an upright trunk, planted feet.

Each cost is twice a negative log likelihood up to a constant, with the heavy tails of Student's t,
because every rule here has exceptions (a tilted camera, a fall, a lying body, stairs). Directions
are candidates for up, (U, 3) unit vectors in the world's axes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.body.mass import centre_of_mass
from imocap_core.conventions import SMPL_JOINTS

ROLL_DOF, PITCH_DOF, BALANCE_DOF, TRUNK_DOF, PLANE_DOF = (
    2.0,
    4.0,
    4.0,
    2.0,
    3.0,
)  # of the t distributions
SUPPORT_HEIGHT_M = 0.06  # a limb this far above the lowest one supports less
HAND_SHARE = 0.3  # of a foot's: how readily hands and knees count as support
SWAY_M = 0.06  # standard deviation of the centre of mass about the middle of its support
LEAN_ACROSS, LEAN_AHEAD = 0.04, 0.25  # errors of the pose as shares of the height: across the
# camera's line of sight and along it
DYNAMIC_S = 0.2  # and as a time at its speed: who moves need not balance
TRUNK_DEG = 8.0
PLANE_M = 0.08  # deviation of a planted foot's height, with its error of depth
PLANTED_M_S = 0.2  # speed at which a foot counts a quarter as planted
LEAST_PLANTED = 0.1  # feet that count less are left out
PLANE_QUANTILE = 0.5
DEPTH_M = 0.08  # of a limb below the floor, with its error of depth

PELVIS, NECK = SMPL_JOINTS.index("pelvis"), SMPL_JOINTS.index("neck")
BALLS = [SMPL_JOINTS.index(f"{side}_foot") for side in ("left", "right")]
ANKLES = [SMPL_JOINTS.index(f"{side}_ankle") for side in ("left", "right")]
HANDS_AND_KNEES = [
    SMPL_JOINTS.index(f"{side}_{part}") for part in ("wrist", "knee") for side in ("left", "right")
]
LIMB_SHARES = np.concatenate(
    [0.5 * (np.eye(24)[ANKLES] + np.eye(24)[BALLS]), np.eye(24)[HANDS_AND_KNEES]]
)
"""(6, 24) weights of SMPL's joints whose mean is a limb that may support: feet, wrists, knees."""


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
        limbs: (N, 6, 3) feet, wrists, knees; trunk: (N, 3) unit vectors from pelvis to neck.
        feet: (M, 3) balls of slow feet; planted: (M,) their weights.
    """

    centre: Float[np.ndarray, "N 3"]
    speed_m_s: Float[np.ndarray, " N"]
    limbs: Float[np.ndarray, "N 6 3"]
    trunk: Float[np.ndarray, "N 3"]
    feet: Float[np.ndarray, "M 3"]
    planted: Float[np.ndarray, " M"]


def support_of(joints: Float[np.ndarray, "T 24 3"], fps: float, moments: int) -> Support:
    """Support at up to `moments` moments of a motion without gaps."""
    centre = centre_of_mass(joints)
    step = np.gradient(centre, axis=0) if len(joints) > 1 else np.zeros_like(centre)
    index = np.unique(np.linspace(0, len(joints) - 1, moments).round().astype(np.int64))
    chosen = joints[index]
    trunk = chosen[:, NECK] - chosen[:, PELVIS]
    feet, planted = planted_feet(joints, fps)
    some = np.unique(np.linspace(0, len(feet) - 1, 2 * moments).round().astype(np.int64))
    return Support(
        centre=centre[index],
        speed_m_s=fps * np.linalg.norm(step[index], axis=-1),
        limbs=np.einsum("sj,njc->nsc", LIMB_SHARES, chosen),
        trunk=trunk / np.maximum(np.linalg.norm(trunk, axis=-1, keepdims=True), 1e-9),
        feet=feet[some],
        planted=planted[some],
    )


def planted_feet(
    joints: Float[np.ndarray, "T 24 3"], fps: float
) -> tuple[Float[np.ndarray, "M 3"], Float[np.ndarray, " M"]]:
    """Places of the balls of slow feet, and weights by their speed; the slowest if none is slow."""
    feet = joints[:, BALLS]
    if len(feet) == 1:
        return feet[0], np.ones(len(BALLS))
    middle = (0.5 * (feet[1:] + feet[:-1])).reshape(-1, 3)
    speed = fps * np.linalg.norm(feet[1:] - feet[:-1], axis=-1).ravel()
    weight = 1.0 / (1.0 + (speed / PLANTED_M_S) ** 2) ** 2
    slow = weight >= min(LEAST_PLANTED, weight.max())
    return middle[slow], weight[slow]


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


def depth_cost(up: Float[np.ndarray, "U 3"], support: Support) -> Float[np.ndarray, " U"]:
    """No limb is below the height of planted feet; the mean over moments."""
    floor = weighted_quantile(up @ support.feet.T, support.planted, PLANE_QUANTILE)
    lowest = np.einsum("nsc,uc->usn", support.limbs, up).min(axis=1)
    depth = np.maximum(floor[:, None] - lowest, 0.0)
    return np.asarray(_student(depth / DEPTH_M, PLANE_DOF).mean(axis=1))


def balance_cost(
    up: Float[np.ndarray, "U 3"], support: Support, sight: Float[np.ndarray, "3"]
) -> Float[np.ndarray, " U"]:
    """The centre of mass is above the limbs that stand on the ground; the mean over moments.

    A density of the centre's place: narrow supports claim more of it than wide ones.
    """
    squared, determinant = _off_support(up, support, sight, LEAN_AHEAD)
    cost = _student(np.sqrt(squared), BALANCE_DOF, dimensions=2)
    return np.asarray((cost + np.log(determinant / SWAY_M**4)).mean(axis=1))


def falling_cost(
    up: Float[np.ndarray, "U 3"], support: Support, sight: Float[np.ndarray, "3"], ahead: float
) -> Float[np.ndarray, " U"]:
    """How far the centre of mass is off its support, whichever that is; the mean over moments.

    ahead: error of the pose along the line of sight, as a share of the centre's height.
    """
    squared, _ = _off_support(up, support, sight, ahead)
    return np.asarray(_student(np.sqrt(squared), BALANCE_DOF, dimensions=2).mean(axis=1))


def _off_support(
    up: Float[np.ndarray, "U 3"], support: Support, sight: Float[np.ndarray, "3"], ahead: float
) -> tuple[Float[np.ndarray, "U N"], Float[np.ndarray, "U N"]]:
    """Squared horizontal distance of the centre of mass from its support's middle in standard
    deviations, and the determinant of their covariance, m^4.

    Limbs as low as the lowest one are the support. The distance is compared with their extent, the
    body's sway and the pose's errors.
    """
    axes = np.stack([up, *perpendicular(up)])  # (3, U, 3): up, and two horizontal directions
    moments, count, _ = support.limbs.shape
    limbs = axes @ support.limbs.swapaxes(0, 1).reshape(-1, 3).T
    limbs = limbs.reshape(3, len(up), count, moments)  # along each axis
    share = _shares(limbs[0])
    middle = (share * limbs).sum(axis=2)
    height, x, y = axes @ support.centre.T - middle  # (U, N) each
    apart_x, apart_y = limbs[1:] - middle[1:, :, None]
    free = SWAY_M**2 + (LEAN_ACROSS * height) ** 2 + (DYNAMIC_S * support.speed_m_s) ** 2
    along = (ahead**2 - LEAN_ACROSS**2) * height**2
    ahead_x, ahead_y = (axes[1:] @ sight)[..., None]
    weighted_x = share * apart_x
    a = 0.5 * (weighted_x * apart_x).sum(axis=1) + along * ahead_x**2 + free
    b = 0.5 * (weighted_x * apart_y).sum(axis=1) + along * ahead_x * ahead_y
    c = 0.5 * (share * apart_y * apart_y).sum(axis=1) + along * ahead_y**2 + free
    determinant = a * c - b**2
    return (c * x**2 - 2 * b * x * y + a * y**2) / determinant, determinant


def weighted_quantile(
    values: Float[np.ndarray, "U M"], weights: Float[np.ndarray, " M"], share: float
) -> Float[np.ndarray, " U"]:
    """Quantile of each row."""
    order = np.argsort(values, axis=1)
    cumulated = np.cumsum(weights[order], axis=1)
    place = (cumulated >= share * cumulated[:, -1:]).argmax(axis=1)
    return np.asarray(np.take_along_axis(values, order, axis=1)[np.arange(len(values)), place])


def support_under(
    up: Float[np.ndarray, "U 3"], support: Support
) -> tuple[Float[np.ndarray, "U N 3"], Float[np.ndarray, "U N 3 3"]]:
    """Mean of the supporting limbs, and half their covariance: pressure is mostly in the middle."""
    share = support_shares(up, support)
    middle = np.einsum("uns,nsc->unc", share, support.limbs)
    apart = support.limbs[None] - middle[:, :, None]
    return middle, 0.5 * np.einsum("uns,unsi,unsj->unij", share, apart, apart)


def support_shares(up: Float[np.ndarray, "U 3"], support: Support) -> Float[np.ndarray, "U N 6"]:
    """How much each limb supports, by its height above the lowest one; their sum is 1."""
    return _shares(np.einsum("nsc,uc->usn", support.limbs, up)).swapaxes(1, 2)


def _shares(height: Float[np.ndarray, "*any 6 N"]) -> Float[np.ndarray, "*any 6 N"]:
    """The same of limbs at some heights."""
    above = height - height.min(axis=-2, keepdims=True)
    share = np.where(np.arange(height.shape[-2]) < len(BALLS), 1.0, HAND_SHARE)[:, None]
    share = share * np.exp(-0.5 * (above / SUPPORT_HEIGHT_M) ** 2)
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

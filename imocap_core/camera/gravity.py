"""The one world that is level: direction of gravity, ground plane, camera axes to world axes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from imocap_core.camera.ground_plane import Ground
from imocap_core.camera.tilt_evidence import (
    ANKLES,
    BALLS,
    ELBOWS,
    PART_RADII_M,
    PARTS,
    TRUNK_DEG,
    WRISTS,
    LevelPrior,
    Support,
    balance_costs,
    camera_angles_deg,
    camera_cost,
    carried_cost,
    hands_cost,
    perpendicular,
    plane_cost,
    planted_feet,
    planted_weight,
    support_of,
    trunk_cost,
    weighted_quantile,
)
from imocap_core.rotations import unwrap


@dataclass(frozen=True)
class BodyMotion:
    """The motion of one video's body, in the axes of a camera or of the world.

    theta: axis-angle pose, radians, the root first. trans: SMPL's translation, metres. joints:
    metres, the pelvis first.
    """

    theta: Float[np.ndarray, "T P"]
    trans: Float[np.ndarray, "T 3"]
    joints: Float[np.ndarray, "T J 3"]


@dataclass(frozen=True)
class Extrinsics:
    """Camera pose: x_cam = R x_world + t, t in metres."""

    R: Float[np.ndarray, "3 3"]
    t: Float[np.ndarray, "3"]


@dataclass(frozen=True)
class GroundAlignment:
    """Rigid transform to an upright world, one axis up and the ground at 0:
    x_upright = R_upright_from_world x_world + t, metres."""

    R_upright_from_world: Float[np.ndarray, "3 3"]
    t: Float[np.ndarray, "3"]


def to_world(motion: BodyMotion, camera: Extrinsics) -> BodyMotion:
    """A motion in camera axes, in world axes: x_world = R^T (x_cam - t).

    Of theta only the root's rotation changes; its axis-angle vector is unwrapped over time. trans
    is not a point of the body but a shift relative to the rest pose's pelvis, which does not
    change: pelvis = rest pelvis + trans.
    """
    R_world_from_cam = camera.R.T
    root = Rotation.from_matrix(R_world_from_cam) * Rotation.from_rotvec(motion.theta[:, :3])
    rest_pelvis = motion.joints[:, 0] - motion.trans
    joints = (motion.joints - camera.t) @ camera.R
    root_path = unwrap(torch.as_tensor(root.as_rotvec())).numpy()
    theta = np.concatenate([root_path, motion.theta[:, 3:]], axis=1)
    return BodyMotion(theta, joints[:, 0] - rest_pelvis, joints)


def align_motion_to_ground(motion: BodyMotion, ground: GroundAlignment) -> BodyMotion:
    """A motion in world axes, in the upright world."""
    R_world_from_upright = ground.R_upright_from_world.T
    return to_world(motion, Extrinsics(R_world_from_upright, -R_world_from_upright @ ground.t))


def align_camera_to_ground(camera: Extrinsics, ground: GroundAlignment) -> Extrinsics:
    """The pose of a camera relative to the upright world."""
    R_cam_from_upright = camera.R @ ground.R_upright_from_world.T
    return Extrinsics(R_cam_from_upright, camera.t - R_cam_from_upright @ ground.t)


def y_up_axes(up: str) -> Float[np.ndarray, "3 3"]:
    """Rotation from a world whose y or z points up to one whose y does: (x, y, z) to (x, z, -y)."""
    return (
        np.eye(3) if up == "y" else np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    )


def on_floor(points: Float[np.ndarray, "... 3"], up: str) -> Float[np.ndarray, "... 3"]:
    """Points projected to the floor of a levelled world whose y or z points up."""
    return points * np.where(np.array(["x", "y", "z"]) == up, 0.0, 1.0)


def heading(R: Float[np.ndarray, "T 3 3"]) -> Float[np.ndarray, "T 3 3"]:
    """Twist of rotations over time about y, which points up; it does not jump."""
    angle = np.unwrap(2 * np.arctan2(R[:, 0, 2] - R[:, 2, 0], 1 + np.trace(R, axis1=1, axis2=2)))
    return np.asarray(Rotation.from_rotvec(angle[:, None] * np.array([0.0, 1.0, 0.0])).as_matrix())


MOMENTS = 40  # of a video that are looked at
CORRELATION_S = 0.5  # errors of a pose persist: so long a time counts as one observation
MOST_OBSERVATIONS = 5.0  # and a video's common error remains, however long it is
OTHER_OBSERVATIONS = 3.0  # of what carries a body otherwise, which is a guess
WRONG_SHARE = 0.02  # of motions that lean to or from the camera as a whole
ROLLS_DEG, PITCHES_DEG = np.arange(-180.0, 181.0, 5.0), np.arange(-60.0, 61.0, 6.0)
BY_WHAT = (0.93, 0.05, 0.01, 0.01)  # shares of videos: feet carry, other parts, hands, a bench
EQUALLY = (0.25, 0.25, 0.25, 0.25)
STANDING_COST = 4.5  # of balance and trunk for who stands: densities of a narrow and a wide support
RESTING_COST = 4.2  # of balance alone
TRUNK_SHARE = 0.3  # of the evidence of balance, which speaks of nearly the same
SPHERE = 1000  # directions that are compared first, 7 degrees apart
REFINEMENTS, GRID, REACH_SD = 3, 17, 4.0
FIRST_REACH_DEG, LEAST_REACH_DEG, MOST_REACH_DEG = 12.0, 2.0, 30.0
SEARCHED_DEG = (30.0, 5.0)  # about a level camera's up, then about the best
APART_DEG, MOST_MODES, HOPELESS = 25.0, 3, 12.0  # of proposals: angle, number, cost above the least
CHUNK = 100  # directions evaluated together, so that their arrays stay in the processor's cache


@dataclass(frozen=True)
class FilmedBody:
    """One video's body in the axes of the world, and the mean of its camera's rotations.

    joints: SMPL's, metres; frames without all of them are left out. shown: how far each is, 0 to 1;
    None: all are.
    """

    joints: Float[np.ndarray, "T 24 3"]
    fps: float
    R_cam_from_world: Float[np.ndarray, "3 3"]
    shown: Float[np.ndarray, "T 24"] | None = None

    @property
    def whole(self) -> Bool[np.ndarray, " T"]:
        """Frames that have all joints."""
        return np.asarray(np.isfinite(self.joints).all(axis=(1, 2)))

    @property
    def joints_shown(self) -> Float[np.ndarray, "T 24"]:
        """`shown`, 1 where it is not given."""
        return np.ones(self.joints.shape[:2]) if self.shown is None else self.shown

    @property
    def feet_shown(self) -> float:
        """Share of the frames in which a foot is seen; what carries a body otherwise is a guess,
        which tells nothing of up."""
        return float(self.joints_shown[:, ANKLES].max(axis=1).mean())


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
    hidden = 1 - max((body.feet_shown for body in bodies if body.whole.any()), default=1.0)
    trunks = [_trunk_in_depth(body) for body in bodies if hidden > 0 and body.whole.any()]

    def cost(up: Float[np.ndarray, "U 3"]) -> Float[np.ndarray, " U"]:
        total = np.zeros(len(up))
        total += sum(camera_cost(up, b.R_cam_from_world, prior) for b in bodies)
        total += sum(stance.cost(up) for stance in stances)
        total += sum(hidden * trunk(up) for trunk in trunks)
        return total

    return _searched(cost, [b.R_cam_from_world for b in bodies], prior)


def gravity_cost(body: FilmedBody, prior: LevelPrior) -> float:
    """Twice the negative log likelihood of the likeliest up if the body's motion is right: how far
    that is from what cameras that are held level see of bodies that anything may carry."""
    stance, R = _Stance.of(body), body.R_cam_from_world
    if stance is None:
        return 0.0
    up, least = (_up_of_angles(np.zeros(1), np.array([prior.pitch_down_deg])) @ R)[0], np.inf
    carried = partial(stance.if_right, by_what=EQUALLY)
    for reach_deg in SEARCHED_DEG:
        near = _grid(up, reach_deg)
        costs = camera_cost(near, R, prior) + _in_chunks(carried)(near)
        up, least = near[costs.argmin()], min(least, float(costs.min()))
    return least


Cost = Callable[[Float[np.ndarray, "U 3"]], Float[np.ndarray, " U"]]


def _searched(
    cost: Cost, cameras: Sequence[Float[np.ndarray, "3 3"]], prior: LevelPrior
) -> UpEstimate:
    """The likeliest of few ups, and its standard deviation.

    Proposed are cameras that are held level and the least costs on the sphere. The proposal with
    the most posterior around it is chosen, not their mean; how likely it is one of the others
    shows in the standard deviation. Proposals that lead to the same up count once.
    """
    level = _up_of_angles(np.zeros(1), np.array([prior.pitch_down_deg]))
    sphere = np.concatenate([*(level @ R for R in cameras), _fibonacci_sphere(SPHERE)])
    costs = cost(sphere)
    modes, hopeless = list[_Mode](), costs.min() + HOPELESS
    while costs.min() <= hopeless and len(modes) < MOST_MODES:
        start = sphere[costs.argmin()]
        costs[_angles_deg(start, sphere) <= APART_DEG] = np.inf
        every = sorted([*modes, _Mode.around(cost, start)], key=lambda m: m.cost)
        modes.clear()
        for mode in every:
            if all(_angles_deg(mode.mean, m.mean) > APART_DEG for m in modes):
                modes.append(mode)
    best = modes[0]
    share = np.exp(-0.5 * np.array([m.cost - best.cost for m in modes]))
    share /= share.sum()
    apart_deg = np.array([_angles_deg(best.mean, m.mean).item() for m in modes])
    spread = np.array([m.sd_deg for m in modes]) ** 2 + apart_deg**2 / 2
    return UpEstimate(best.mean, float(np.sqrt(share @ spread)))


@dataclass(frozen=True)
class _Mode:
    """The posterior around one direction: its mean, spread, -2 log of its integral."""

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
        return cls(mean, sd, whole)


def _angles_deg(a: Float[np.ndarray, "3"], b: Float[np.ndarray, "*U 3"]) -> Float[np.ndarray, "*U"]:
    return np.asarray(np.degrees(np.arccos(np.clip(b @ a, -1.0, 1.0))))


def _in_chunks(cost: Cost) -> Cost:
    """The same cost of few directions at a time, so that its arrays stay in the cache."""

    def of(up: Float[np.ndarray, "U 3"]) -> Float[np.ndarray, " U"]:
        return np.concatenate([cost(up[k : k + CHUNK]) for k in range(0, len(up), CHUNK)])

    return of


@dataclass(frozen=True)
class _Stance:
    """What one body tells: its support, its camera, how many independent observations it is
    worth."""

    support: Support
    R_cam_from_world: Float[np.ndarray, "3 3"]
    count: float

    @classmethod
    def of(cls, body: FilmedBody) -> _Stance | None:
        whole, shown = body.whole, body.feet_shown
        if not whole.any() or shown == 0:
            return None
        count = min(float(whole.sum()) / body.fps / CORRELATION_S, MOST_OBSERVATIONS) * shown
        support = support_of(body.joints[whole], body.fps, MOMENTS, body.joints_shown[whole])
        return cls(support, body.R_cam_from_world, count)

    @cached_property
    def of_roll(self) -> Float[np.ndarray, " N"]:
        """The least cost over the pitch of the camera for each roll (of ROLLS_DEG)."""
        roll, pitch = np.meshgrid(ROLLS_DEG, PITCHES_DEG, indexing="ij")
        up = _up_of_angles(roll.ravel(), pitch.ravel()) @ self.R_cam_from_world
        costs = _in_chunks(self.if_right)(up)
        return np.asarray(costs.reshape(roll.shape).min(axis=1))

    def if_right(
        self, up: Float[np.ndarray, "U 3"], by_what: Sequence[float] = BY_WHAT
    ) -> Float[np.ndarray, " U"]:
        """As if the pose were right: the body stands on its feet, upright more often than not; or,
        throughout a video, other parts or furniture carry it, and nothing is known of its trunk."""
        sight, plane = self.R_cam_from_world[2], plane_cost(up, self.support)
        stands, rests = balance_costs(up, self.support, sight)
        feet = stands + plane + TRUNK_SHARE * trunk_cost(up, self.support) - STANDING_COST
        others = carried_cost(up, self.support, sight)
        hands = hands_cost(up, self.support, sight)
        bench = rests + plane - RESTING_COST
        count = min(self.count, OTHER_OBSERVATIONS)
        costs = np.stack([self.count * feet, count * others, count * hands, count * bench])
        return _mixed(costs, by_what)

    def cost(self, up: Float[np.ndarray, "U 3"]) -> Float[np.ndarray, " U"]:
        """The same when the whole motion may lean in depth, which a view shows least: then it tells
        the camera's roll alone."""
        roll, _ = camera_angles_deg(up, self.R_cam_from_world)
        wrong = np.interp(roll, ROLLS_DEG, self.of_roll)
        right = _in_chunks(self.if_right)(up)
        return _mixed(np.stack([right, wrong]), (1 - WRONG_SHARE, WRONG_SHARE))


def _trunk_in_depth(body: FilmedBody) -> Cost:
    """Evidence of the trunk where no video shows the feet: upright in depth, or in any direction.
    Its lean across the picture is seen, and says nothing of the camera's roll."""
    R = body.R_cam_from_world
    support = support_of(body.joints[body.whole], body.fps, MOMENTS)
    any_way = 2 * np.log(2 / np.radians(TRUNK_DEG) ** 2)  # its density against the whole sphere's

    def cost(up: Float[np.ndarray, "U 3"]) -> Float[np.ndarray, " U"]:
        _, down = camera_angles_deg(up, R)
        trunk = trunk_cost(_up_of_angles(np.zeros(len(up)), down) @ R, support)
        return _mixed(np.stack([trunk, np.full_like(trunk, any_way)]), (0.5, 0.5))

    return cost


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


BALL_ABOVE_SOLE_M = 0.027  # SMPL's foot joint above the sole, in the free body at rest
HEEL_RADIUS_M = 0.06  # of the heel about the ankle, which is lower where toes point up
HEIGHT_ROUNDS, HEIGHT_SCALE_M = 5, 0.05
LEAST_HEIGHT_SD_M = 0.01
PLANTED_QUANTILE = 0.4  # of slow feet: the others may be held still above the ground
ARM_PARTS = [k for k, joint in enumerate(PARTS) if joint in WRISTS + ELBOWS]
FEET_CARRY_M = 0.15  # above the lowest part: higher feet do not tell the floor
LEAST_SIDEWAYS = 0.1  # length of a camera's horizontal direction below which it looks up or down
Z_UP_FROM_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def estimate_ground(bodies: Sequence[FilmedBody], prior: LevelPrior) -> Ground:
    """The ground under bodies in one world, and its uncertainty.

    Without a frame that has all joints: up by the cameras, the height unknown (NaN).
    """
    estimate = estimate_up(bodies, prior)
    whole = [b.joints[b.whole] for b in bodies]
    rows = [_standing_on(b, estimate.up) for b in bodies if b.whole.any()]
    if not rows:
        return Ground(estimate.up, np.zeros(3), estimate.sd_deg, float("nan"))
    soles, planted = (np.concatenate(parts) for parts in zip(*rows, strict=True))
    height, height_sd_m = _height(soles, planted, len(rows))
    middle = np.concatenate(whole)[:, 0].mean(axis=0)
    origin = middle + (height - middle @ estimate.up) * estimate.up
    return Ground(estimate.up, origin, estimate.sd_deg, 1000 * height_sd_m)


def upright_alignment(
    ground: Ground, R_cam_from_world: Float[np.ndarray, "3 3"], up_axis: str
) -> GroundAlignment:
    """From a world to the one that is level with its ground, with y or z up.

    Its origin is the ground's. y up: a camera, that of the reference video, looks along -z, its
    right is x. z up is the same world turned by a quarter about x (x, -z, y): it looks along y.

    Raises:
        ValueError: another axis.
    """
    if up_axis not in ("y", "z"):
        raise ValueError(f"up axis: expected y or z, got {up_axis!r}")
    ahead = R_cam_from_world[2]
    if np.linalg.norm(np.cross(ahead, ground.up)) < LEAST_SIDEWAYS:
        ahead = R_cam_from_world[1] * np.sign(ahead @ ground.up)  # looking down: the picture's top
    right = np.cross(ahead, ground.up)
    right /= np.linalg.norm(right)
    R = np.stack([right, ground.up, np.cross(right, ground.up)])
    if up_axis == "z":
        R = Z_UP_FROM_Y_UP @ R
    return GroundAlignment(R, -R @ ground.origin)


def sole_depths_mm(joints: Float[np.ndarray, "T 24 3"], ground: Ground) -> Float[np.ndarray, " T"]:
    """How far the lower sole is below the ground, millimetres; 0 above it."""
    return np.asarray(1000 * np.maximum(-sole_heights_m(joints, ground), 0.0))


def sole_heights_m(joints: Float[np.ndarray, "T 24 3"], ground: Ground) -> Float[np.ndarray, " T"]:
    """Height of the lower sole above the ground."""
    return np.asarray((ground.height_m(joints[:, BALLS]) - BALL_ABOVE_SOLE_M).min(axis=1))


def lowest_heights_m(
    joints: Float[np.ndarray, "T 24 3"], ground: Ground
) -> Float[np.ndarray, " T"]:
    """Height of the lowest body part (soles, hands, knees, hips, ...) above the ground."""
    parts = ground.height_m(joints[:, PARTS]) - PART_RADII_M
    return np.minimum(sole_heights_m(joints, ground), parts.min(axis=1))


def _standing_on(
    body: FilmedBody, up: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, " N"], Float[np.ndarray, " N"]]:
    """Heights of planted soles, and their weights; of the lowest part where no foot is as low, of
    arms only if they are seen."""
    joints, shown = body.joints[body.whole], body.joints_shown[body.whole]
    parts = joints[:, PARTS] @ up - PART_RADII_M
    parts[:, ARM_PARTS] += np.where(shown[:, PARTS][:, ARM_PARTS] > 0, 0.0, np.inf)
    lowest = parts.argmin(axis=1)
    balls, heels = joints[:, BALLS] - BALL_ABOVE_SOLE_M * up, joints[:, ANKLES] - HEEL_RADIUS_M * up
    soles = np.where((heels @ up < balls @ up)[..., None], heels, balls)
    on_feet = (soles @ up).min(axis=1) < parts.min(axis=1) + FEET_CARRY_M
    heights, weights = [parts.min(axis=1)[~on_feet]], []
    steps = np.diff(joints[:, PARTS], axis=0, append=joints[-1:, PARTS])
    speed = body.fps * np.linalg.norm(steps, axis=-1)
    weights.append(planted_weight(speed[np.arange(len(joints)), lowest])[~on_feet])
    if on_feet.any():
        feet, planted = planted_feet(soles[on_feet], body.fps, shown[on_feet][:, BALLS])
        heights.append(feet @ up)
        weights.append(planted)
    return np.concatenate(heights), np.concatenate(weights)


def _height(
    heights: Float[np.ndarray, " N"], planted: Float[np.ndarray, " N"], videos: int
) -> tuple[float, float]:
    """Height of planted feet, and its standard deviation, by reweighted least squares (Cauchy).

    Errors of one video are one error: it counts once.
    """
    height = float(weighted_quantile(heights[None], planted, PLANTED_QUANTILE)[0])
    weight = planted
    for _ in range(HEIGHT_ROUNDS):
        weight = planted / (1.0 + ((heights - height) / HEIGHT_SCALE_M) ** 2)
        height = float(np.average(heights, weights=weight))
    variance = float(np.average((heights - height) ** 2, weights=weight))
    return height, max(float(np.sqrt(variance / videos)), LEAST_HEIGHT_SD_M)

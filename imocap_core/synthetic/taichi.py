"""The tai chi demo: a short form as keyframed poses and hands, and one video of it.

Commencing, parting the horse's mane, brush knee, cloud hands to both sides, cross hands, closing.
The stance is narrow, wide or one foot before the other, and the weight shifts over the feet.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.interpolate import PchipInterpolator

from imocap_core.body import Shaped, load_free_body
from imocap_core.camera.projection import camera_from_world, project_camera
from imocap_core.conventions import SIDES, SMPL_JOINTS
from imocap_core.hands.hand_skeleton import ANGLE_NAMES, HandSkeleton, hand_skeleton, joint_vectors
from imocap_core.rotations import exp
from imocap_core.synthetic.cameras import CameraPlacement, FilmCamera, aim_camera
from imocap_core.synthetic.choreography import PHASE_PER_S, PhaseSpan, contact_forward, perform
from imocap_core.synthetic.detector import (
    Detections,
    detect,
    false_people,
    persistent_noise,
    simulated_confidence,
)
from imocap_core.synthetic.yoga import Arms, Key, Leg
from imocap_core.synthetic.yoga_clip import LAYOUT, DemoClip, DemoHands, draw_betas

_STYLE_DEG = 6.0  # standard deviation of each angle from performance to performance,
_MOMENT_DEG = 4.0  # and from key to key
_SPREAD_SHARE = 0.4  # of these, for angles that spread or twist
_ODD_DEG = 2.0  # of each joint about any axis: real joints have no ideal axes
_NOISE = 0.03  # standard deviation of a point, share of the hand's length
_FLOOR_PX = 0.5
_PERSISTENCE_S = 0.3
_OUTLIER_RATE, _OUTLIER_NOISE, _MISS_RATE = 0.02, 0.3, 0.03
_LOST_PER_S, _LOST_S = 0.15, 0.4  # times in which a whole hand is not detected


def perform_fingers(
    hands: Sequence[tuple[str, str]],
    poses: Mapping[str, Float[np.ndarray, "21"]],
    key_times: Float[np.ndarray, " N"],
    time_s: Float[np.ndarray, " T"],
    skeleton: HandSkeleton,
    rng: np.random.Generator,
) -> Float[np.ndarray, "T 30 3 3"]:
    """Local finger rotations of the left, then the right hand, in SMPL+H's order.

    hands: names of the left and right hand's pose at each of the N keys. poses: angles in degrees.
    """
    authored = np.array([[poses[name] for name in pair] for pair in hands])  # (N, 2, 21) degrees
    share = np.array([1.0 if "bend" in name else _SPREAD_SHARE for name in ANGLE_NAMES])
    style = rng.normal(0.0, _STYLE_DEG, authored.shape[1:])
    varied = authored + share * (style + rng.normal(0.0, _MOMENT_DEG, authored.shape))
    limits = [np.rad2deg(x.numpy()) for x in (skeleton.lower, skeleton.upper)]
    angles = PchipInterpolator(key_times, np.clip(varied, *limits))(time_s)
    vectors = joint_vectors(skeleton.axes, torch.as_tensor(np.deg2rad(angles)))
    odd = np.deg2rad(rng.normal(0.0, _ODD_DEG, vectors.shape[1:]))
    return (exp(vectors) @ exp(torch.as_tensor(odd))).flatten(1, 3).numpy()


def detect_hands(
    xy_px: Float[np.ndarray, "T 2 21 2"],
    length_px: Float[np.ndarray, "T 2"],
    hidden: Bool[np.ndarray, "T 2"],
    fps: float,
    rng: np.random.Generator,
) -> Detections:
    """Simulated detection of both hands.

    Errors are proportional to the hand's length, half of their variance is correlated over time; a
    hand that is not detected is all zeros.

    Args:
        xy_px: true points. length_px: of each hand in the picture. hidden: behind the body.
    """
    frames = len(xy_px)
    sigma = np.hypot(_NOISE * length_px, _FLOOR_PX)[..., None, None]
    offset = sigma * persistent_noise(xy_px.shape, _PERSISTENCE_S * fps, rng)
    outlier = rng.random(xy_px.shape[:3]) < _OUTLIER_RATE
    jump = length_px[..., None, None] * rng.normal(0.0, _OUTLIER_NOISE, xy_px.shape)
    offset = offset + outlier[..., None] * jump
    confidence = simulated_confidence(np.linalg.norm(offset, axis=-1) / sigma[..., 0], rng)
    begins = rng.random((frames, 2)) < _LOST_PER_S / fps
    duration = np.ones(max(1, round(_LOST_S * fps)))
    lost = np.stack([np.convolve(begins[:, s], duration)[:frames] > 0 for s in range(2)], axis=1)
    missed = (rng.random(xy_px.shape[:3]) < _MISS_RATE) | (lost | hidden)[..., None]
    return Detections(
        np.where(missed[..., None], 0.0, xy_px + offset), np.where(missed, 0.0, confidence)
    )


DURATION_S = 8.0

_NARROW = Leg(hip=4, knee=10)
_WIDE = Leg(hip=20, knee=40, place="wide")
_AHEAD = Leg(hip=42, knee=50, place="forward")
_BEHIND = Leg(hip=-4, knee=22, place="front")
_HANGING = Arms(lift=-80, open=16, elbow=16, twist=-70)
_BALL_ABOVE = Arms(lift=-8, open=30, elbow=92, twist=-15, shrug=3)
_BALL_BELOW = Arms(lift=-58, open=14, elbow=72, twist=-55, forearm=70)
_GUARD = Arms(lift=-62, open=24, elbow=42, twist=-75, wrist=30)
_BEFORE_FACE = Arms(lift=14, open=28, elbow=78, twist=-40, forearm=25, shrug=4)
_BEFORE_BELLY = Arms(lift=-50, open=12, elbow=66, twist=-50, forearm=35)

TAI_CHI: tuple[Key, ...] = (
    Key("standing", 0.0, (0.93, -0.02), lean=0, left=_NARROW, right=_NARROW, arms=_HANGING),
    Key("opening step", 0.7, (0.89, -0.02), lean=0, left=_WIDE, right=_NARROW, arms=_HANGING,
        side_m=-0.01),
    Key("arms rise", 1.4, (0.88, -0.02), lean=0, left=_WIDE, right=_NARROW,
        arms=Arms(lift=-2, open=8, elbow=24, twist=-40, wrist=-28, shrug=4), side_m=0.06),
    Key("arms sink", 2.1, (0.82, -0.03), lean=4, left=_WIDE, right=_NARROW,
        arms=Arms(lift=-58, open=10, elbow=66, twist=-75, wrist=38), side_m=0.06),
    Key("holding the ball", 2.8, (0.82, -0.03), lean=4, left=_WIDE, right=_NARROW,
        arms=_BALL_BELOW, right_arm=_BALL_ABOVE, side_m=-0.04, turn=-14),
    Key("parting the mane", 3.6, (0.82, 0.16), lean=5, left=_AHEAD, right=_BEHIND,
        arms=Arms(lift=2, open=16, elbow=38, twist=-55, forearm=55), right_arm=_GUARD,
        side_m=0.03, turn=12),
    Key("brushing the knee", 4.4, (0.82, 0.14), lean=6, left=_AHEAD, right=_BEHIND,
        arms=_GUARD, right_arm=Arms(lift=-4, open=6, elbow=30, twist=-65, wrist=52),
        side_m=0.03, turn=8),
    Key("cloud hands, left", 5.2, (0.83, -0.02), lean=2, left=_WIDE, right=_NARROW,
        arms=_BEFORE_FACE, right_arm=_BEFORE_BELLY, side_m=0.10, turn=22),
    Key("cloud hands, right", 6.0, (0.83, -0.02), lean=2, left=_WIDE, right=_NARROW,
        arms=_BEFORE_BELLY, right_arm=_BEFORE_FACE, side_m=-0.01, turn=-22),
    Key("crossing hands", 6.7, (0.86, -0.02), lean=0, left=_WIDE, right=_NARROW,
        arms=Arms(lift=-12, open=14, elbow=80, twist=-30, forearm=30), side_m=0.04),
    Key("closing step", 7.4, (0.91, -0.02), lean=0, left=_NARROW, right=_NARROW,
        arms=Arms(lift=-52, open=12, elbow=40, twist=-70, wrist=22)),
    Key("standing again", 8.0, (0.93, -0.02), lean=0, left=_NARROW, right=_NARROW, arms=_HANGING),
)  # fmt: skip

# left and right hand at each key
HANDS: tuple[tuple[str, str], ...] = (
    ("relaxed", "relaxed"),
    ("relaxed", "relaxed"),
    ("relaxed", "relaxed"),
    ("open", "open"),
    ("round", "round"),
    ("open", "point"),
    ("fist", "open"),
    ("round", "point"),
    ("point", "round"),
    ("fist", "fist"),
    ("open", "open"),
    ("relaxed", "relaxed"),
)


def _finger(bend1: float, bend2: float, bend3: float, spread: float = 0.0) -> tuple[float, ...]:
    return (bend1, spread, bend2, bend3)


def _hand(*fingers: tuple[float, ...]) -> Float[np.ndarray, "21"]:
    """Degrees from the rest pose: index, middle, little and ring finger, thumb."""
    return np.array([angle for finger in fingers for angle in finger])


# the thumb: bend, spread and twist of its root, then its two bends
HAND_POSES: dict[str, Float[np.ndarray, "21"]] = {
    "relaxed": _hand(
        _finger(8, 12, 6), _finger(12, 14, 8), _finger(18, 18, 10), _finger(15, 16, 9),
        (4, 0, 0, 6, 8),
    ),
    "open": _hand(
        _finger(-14, -10, -8, 5), _finger(-14, -10, -8), _finger(-12, -10, -8, -9),
        _finger(-14, -10, -8, -4), (-12, 8, 0, -4, -8),
    ),
    "round": _hand(
        _finger(16, 24, 14, 4), _finger(18, 26, 14), _finger(20, 26, 14, -6),
        _finger(19, 26, 14, -3), (0, 14, 4, 8, 10),
    ),
    "point": _hand(
        _finger(-8, -8, -6), _finger(-8, -8, -6, -2), _finger(58, 74, 44), _finger(56, 76, 44),
        (26, 6, 8, 34, 40),
    ),
    "fist": _hand(
        _finger(56, 78, 46), _finger(60, 80, 46), _finger(60, 76, 44), _finger(60, 80, 46),
        (24, -4, 6, 38, 44),
    ),
}  # fmt: skip


SIZE = (424, 540)
TAICHI_SPANS: tuple[PhaseSpan, ...] = (
    PhaseSpan(frames=160, first=2.0, last=236.0, fps=20.0),
    PhaseSpan(frames=172, first=0.0, last=232.0, fps=20.0),
    PhaseSpan(frames=150, first=6.0, last=240.0, fps=20.0),
    PhaseSpan(frames=166, first=3.0, last=238.0, fps=20.0),
)
TAICHI_CAMERAS: tuple[CameraPlacement, ...] = (
    CameraPlacement(-24.0, 3.7, 1.4, 1.9, roll_deg=0.5),
    CameraPlacement(52.0, 3.3, 1.1, 1.65, follow=0.75, wander_deg=2.2, roll_deg=-0.8),
    CameraPlacement(118.0, 4.6, 1.7, 2.3, roll_deg=0.4),
    CameraPlacement(288.0, 3.9, 1.5, 1.95, follow=0.75, wander_deg=2.0, roll_deg=0.9),
)
_HIDDEN_M = 0.13  # a hand nearer to the trunk's axis in the picture, and behind it, is hidden
_PERFORMER = 100  # added to the seed: another performer than in yoga


def taichi_body(seed: int) -> Shaped:
    """The performer of a seed, with fingers."""
    model = load_free_body(dtype=torch.float64, hands=True)
    return model.shape(torch.as_tensor(draw_betas(seed + _PERFORMER, model.num_betas)))


def make_taichi_clip(seed: int, index: int, shaped: Shaped) -> DemoClip:
    """Video `index` (0 to 3) of the tai chi action. shaped: a body with SMPL+H's joints."""
    span, view = TAICHI_SPANS[index], TAICHI_CAMERAS[index]
    motion_rng, camera_rng, detector_rng, finger_rng, hand_rng = (
        np.random.default_rng([seed, 4, index, part]) for part in range(5)
    )
    plain = load_free_body(dtype=torch.float64).shape(shaped.coefficients)
    rest = plain.joints_rest.numpy()
    sole_height = float(plain.vertices_rest[:, 1].min())
    body = perform(TAI_CHI, span, contact_forward(plain), rest, sole_height, motion_rng)
    key_times = np.array([key.time_s for key in TAI_CHI])
    skeleton = hand_skeleton(shaped)
    fingers = perform_fingers(
        HANDS, HAND_POSES, key_times, body.phase / PHASE_PER_S, skeleton, finger_rng
    )
    whole = np.concatenate([body.R_local[:, :22], fingers], axis=1)
    transl = body.pelvis - rest[0]
    posed = shaped.pose(torch.as_tensor(whole), torch.as_tensor(transl))
    joints = plain.pose(torch.as_tensor(body.R_local), torch.as_tensor(transl)).joints.numpy()
    camera = aim_camera(view, body.pelvis, span.fps, SIZE, camera_rng)

    points = shaped.model.points(LAYOUT)
    xy_px, depth = _projected(camera, posed.keypoints(points).numpy())
    stature = float(np.ptp(plain.vertices_rest[:, 1].numpy()))
    height_px = camera.K[1, 1] * stature / depth.mean(axis=1)
    detections = detect(xy_px, height_px, points.names, span.fps, detector_rng)
    others = false_people(detections, SIZE, detector_rng)

    hand_points = [posed.keypoints(shaped.model.points(f"{s}_hand21")).numpy() for s in SIDES]
    hands = np.stack(hand_points, axis=1)
    hands_px, hands_depth = _projected(camera, hands)
    length_px = camera.K[1, 1] * skeleton.length_m.numpy() / hands_depth[..., 0]
    hidden = _hidden(camera, hands, joints)
    detected_hands = detect_hands(hands_px, length_px, hidden, span.fps, hand_rng)
    return DemoClip(
        span.fps,
        SIZE,
        replace(body, R_local=whole),
        transl,
        body.R_local,
        joints,
        camera,
        xy_px,
        detections,
        others,
        view.azimuth_deg,
        DemoHands(hands, detected_hands),
    )


def _projected(
    camera: FilmCamera, points: Float[np.ndarray, "T *points 3"]
) -> tuple[Float[np.ndarray, "T *points 2"], Float[np.ndarray, "T *points"]]:
    """Pixels and depths of world points."""
    flat = points.reshape(len(points), -1, 3)
    in_camera = camera_from_world(flat, camera.R_cam_from_world, camera.t[:, None])
    pixels = project_camera(in_camera, camera.K)
    return pixels.reshape(*points.shape[:-1], 2), in_camera[..., 2].reshape(points.shape[:-1])


def _hidden(
    camera: FilmCamera, hands: Float[np.ndarray, "T 2 21 3"], joints: Float[np.ndarray, "T 24 3"]
) -> Bool[np.ndarray, "T 2"]:
    """Whether the middle of each hand is occluded by the trunk."""
    ends = [SMPL_JOINTS.index(name) for name in ("pelvis", "neck")]
    trunk_px, trunk_depth = _projected(camera, joints[:, ends])
    middle_px, depth = _projected(camera, hands[:, :, 9])
    along = trunk_px[:, 1] - trunk_px[:, 0]
    share = ((middle_px - trunk_px[:, :1]) * along[:, None]).sum(-1) / (along**2).sum(-1)[:, None]
    share = np.clip(share, 0.0, 1.0)
    nearest = trunk_px[:, :1] + share[..., None] * along[:, None]
    reach = _HIDDEN_M * camera.K[0, 0] / depth
    behind = depth > trunk_depth.mean(axis=1, keepdims=True)
    return (np.linalg.norm(middle_px - nearest, axis=-1) < reach) & behind

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
from imocap_core.conventions import SIDES, SMPL_JOINTS
from imocap_core.hands.hand_skeleton import ANGLE_NAMES, HandSkeleton, hand_skeleton, joint_vectors
from imocap_core.rotations import exp
from imocap_core.synthetic.cameras import CameraPlacement, FilmCamera, aim_camera, stature_px
from imocap_core.synthetic.choreography import PHASE_PER_S, PhaseSpan, contact_forward, perform
from imocap_core.synthetic.detector import (
    Detections,
    detect,
    false_people,
    persistent_noise,
    simulated_confidence,
)
from imocap_core.synthetic.yoga import FORMS, keys_of
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


def _perform_fingers(
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


def _detect_hands(
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


TAI_CHI = keys_of("taichi")
HANDS: tuple[tuple[str, str], ...] = tuple((left, right) for *_, left, right in FORMS["taichi"])
HAND_POSES = {name: np.array(deg, dtype=np.float64) for name, deg in FORMS["hands"].items()}

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
    fingers = _perform_fingers(
        HANDS, HAND_POSES, key_times, body.phase / PHASE_PER_S, skeleton, finger_rng
    )
    whole = np.concatenate([body.R_local[:, :22], fingers], axis=1)
    transl = body.pelvis - rest[0]
    posed = shaped.pose(torch.as_tensor(whole), torch.as_tensor(transl))
    joints = plain.pose(torch.as_tensor(body.R_local), torch.as_tensor(transl)).joints.numpy()
    camera = aim_camera(view, body.pelvis, span.fps, SIZE, camera_rng)

    points = shaped.model.points(LAYOUT)
    xy_px, depth = camera.pixels(posed.keypoints(points).numpy())
    height_px = stature_px(plain, camera.K[1, 1], depth)
    detections = detect(xy_px, height_px, points.names, span.fps, detector_rng)
    others = false_people(detections, SIZE, detector_rng)

    hand_points = [posed.keypoints(shaped.model.points(f"{s}_hand21")).numpy() for s in SIDES]
    hands = np.stack(hand_points, axis=1)
    hands_px, hands_depth = camera.pixels(hands)
    length_px = camera.K[1, 1] * skeleton.length_m.numpy() / hands_depth[..., 0]
    hidden = _hidden(camera, hands, joints)
    detected_hands = _detect_hands(hands_px, length_px, hidden, span.fps, hand_rng)
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


def _hidden(
    camera: FilmCamera, hands: Float[np.ndarray, "T 2 21 3"], joints: Float[np.ndarray, "T 24 3"]
) -> Bool[np.ndarray, "T 2"]:
    """Whether the middle of each hand is occluded by the trunk."""
    ends = [SMPL_JOINTS.index(name) for name in ("pelvis", "neck")]
    trunk_px, trunk_depth = camera.pixels(joints[:, ends])
    middle_px, depth = camera.pixels(hands[:, :, 9])
    along = trunk_px[:, 1] - trunk_px[:, 0]
    share = ((middle_px - trunk_px[:, :1]) * along[:, None]).sum(-1) / (along**2).sum(-1)[:, None]
    share = np.clip(share, 0.0, 1.0)
    nearest = trunk_px[:, :1] + share[..., None] * along[:, None]
    reach = _HIDDEN_M * camera.K[0, 0] / depth
    behind = depth > trunk_depth.mean(axis=1, keepdims=True)
    return (np.linalg.norm(middle_px - nearest, axis=-1) < reach) & behind

"""One video of the tai chi demo: a body with fingers, in upright pictures from nearer than yoga."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Bool, Float

from imocap_core.body import Shaped, load_free_body
from imocap_core.camera.projection import camera_from_world, project_camera
from imocap_core.conventions import SIDES, SMPL_JOINTS
from imocap_core.hands.skeleton import hand_skeleton
from imocap_core.synthetic.cameras import CameraPlacement, FilmCamera, aim_camera
from imocap_core.synthetic.demo_body import contact_forward
from imocap_core.synthetic.detector import detect
from imocap_core.synthetic.false_people import false_people
from imocap_core.synthetic.fingers import detect_hands, perform_fingers
from imocap_core.synthetic.taichi import HAND_POSES, HANDS, TAI_CHI
from imocap_core.synthetic.variation import PHASE_PER_S, PhaseSpan, perform
from imocap_core.synthetic.yoga_clip import LAYOUT, DemoClip, DemoHands, draw_betas

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
    camera: FilmCamera,
    hands: Float[np.ndarray, "T 2 21 3"],
    joints: Float[np.ndarray, "T 24 3"],
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

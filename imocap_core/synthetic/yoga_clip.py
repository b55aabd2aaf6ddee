"""Videos of the yoga demo: pictures and simulated detections; the camera stands or walks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, UInt8

from imocap_core.body import Shaped
from imocap_core.render import draw_mesh
from imocap_core.synthetic.cameras import YOGA_CAMERAS, FilmCamera, aim_camera, stature_px
from imocap_core.synthetic.choreography import (
    PhaseSpan,
    SyntheticMotion,
    contact_forward,
    outfit,
    perform,
)
from imocap_core.synthetic.detector import Detections, detect, false_people
from imocap_core.synthetic.rooms import backdrop, cast_shadow, render_plate, room
from imocap_core.synthetic.yoga import SUN_SALUTATION

SIZE = (640, 360)
LAYOUT = "body25"

# All differ in start, end, duration or frame rate.
YOGA_SPANS: tuple[PhaseSpan, ...] = (
    PhaseSpan(frames=168, first=4.0, last=176.0, fps=30.0),
    PhaseSpan(frames=186, first=0.0, last=170.0, fps=30.0),
    PhaseSpan(frames=146, first=9.0, last=180.0, fps=25.0),
    PhaseSpan(frames=158, first=2.0, last=165.0, fps=30.0),
)
_SENSOR_NOISE = 2.0  # grey levels
_SKIN_CHUNK = 16  # frames skinned together
_BETA_SPREAD = 0.5


@dataclass(frozen=True)
class DemoHands:
    """Points of both hands, left first, in the world, metres, and their detections."""

    points_m: Float[np.ndarray, "T 2 21 3"]
    detections: Detections


@dataclass(frozen=True)
class DemoClip:
    """Ground truth of one video, and its simulated detections.

    joints: in the world (z up), metres. xy_px: true keypoints. transl: of the body model. R_smpl:
    rotations of SMPL's 24 joints relative to the parent joint.
    false_people: the false second person of each frame, or None.
    """

    fps: float
    size: tuple[int, int]
    motion: SyntheticMotion
    transl: Float[np.ndarray, "T 3"]
    R_smpl: Float[np.ndarray, "T 24 3 3"]
    joints: Float[np.ndarray, "T 24 3"]
    camera: FilmCamera
    xy_px: Float[np.ndarray, "T 25 2"]
    detections: Detections
    false_people: list[Detections | None]
    azimuth_deg: float
    hands: DemoHands | None = None


def draw_betas(seed: int, count: int) -> Float[np.ndarray, " B"]:
    """Shape coefficients of the performer of a seed."""
    return np.random.default_rng([seed, 0]).normal(0.0, _BETA_SPREAD, count)


def make_yoga_clip(seed: int, index: int, shaped: Shaped) -> DemoClip:
    """Video `index` (0 to 3) of the yoga action. shaped: one body, coefficients (n,)."""
    span, view = YOGA_SPANS[index], YOGA_CAMERAS[index]
    # separate streams, so that a change in one part of the clip leaves the others unchanged
    motion_rng, camera_rng, detector_rng = (
        np.random.default_rng([seed, 1, index, part]) for part in range(3)
    )
    joints_rest = shaped.joints_rest.numpy()
    sole_height = float(shaped.vertices_rest[:, 1].min())
    forward = contact_forward(shaped)
    motion = perform(SUN_SALUTATION, span, forward, joints_rest, sole_height, motion_rng)
    transl = motion.pelvis - joints_rest[0]
    posed = shaped.pose(torch.as_tensor(motion.R_local), torch.as_tensor(transl))
    camera = aim_camera(view, motion.pelvis, span.fps, SIZE, camera_rng)

    points = shaped.model.points(LAYOUT)
    xy_px, depth = camera.pixels(posed.keypoints(points).numpy())
    height_px = stature_px(shaped, camera.K[1, 1], depth)
    detections = detect(xy_px, height_px, points.names, span.fps, detector_rng)
    others = false_people(detections, SIZE, detector_rng)
    joints = posed.joints.numpy()
    return DemoClip(
        span.fps,
        SIZE,
        motion,
        transl,
        motion.R_local,
        joints,
        camera,
        xy_px,
        detections,
        others,
        view.azimuth_deg,
    )


def pictures(
    clip: DemoClip, seed: int, index: int, shaped: Shaped
) -> Iterator[UInt8[np.ndarray, "H W 3"]]:
    """The RGB frames of a clip in order: room, shadow, performer, sensor noise."""
    scene_rng, grain_rng = (np.random.default_rng([seed, 2, index, part]) for part in range(2))
    clothes_rng = np.random.default_rng([seed, 3, index])
    model = shaped.model
    if model.face_parts is None:
        raise ValueError(f"body model {model.name} has no face_parts: nothing to dress")
    colors = outfit(model.face_parts.numpy(), model.part_names, clothes_rng)
    faces = model.faces.numpy().astype(np.int64)
    camera = clip.camera
    surfaces = room(index, clip.azimuth_deg, scene_rng)
    plate = render_plate(surfaces, camera, clip.size)
    width, height = clip.size
    grain = grain_rng.normal(0.0, _SENSOR_NOISE, (2 * height, 2 * width, 1)).astype(np.float32)
    for frame, vertices in enumerate(_skinned(clip, shaped)):
        R, t = camera.R_cam_from_world[frame], camera.t[frame]
        image = backdrop(plate, camera.K, R, clip.size)
        image = cast_shadow(image, vertices, camera.K, R, t)
        image = draw_mesh(image, vertices, faces, colors, camera.K, R, t)
        y, x = grain_rng.integers(height), grain_rng.integers(width)
        noisy = image + grain[y : y + height, x : x + width]
        np.rint(noisy, out=noisy)
        yield np.clip(noisy, 0, 255, out=noisy).astype(np.uint8)


def _skinned(clip: DemoClip, shaped: Shaped) -> Iterator[Float[np.ndarray, "V 3"]]:
    """World vertices of each frame."""
    rotations = torch.as_tensor(clip.motion.R_local)
    transl = torch.as_tensor(clip.transl)
    for start in range(0, len(transl), _SKIN_CHUNK):
        part = slice(start, start + _SKIN_CHUNK)
        yield from shaped.pose(rotations[part], transl[part]).mesh().vertices.numpy()

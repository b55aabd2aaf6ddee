"""A body's motion as a film: a place, a camera and clothes of its own; and what is true of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch

from imocap_core.body import Shaped
from imocap_core.camera.projection import camera_from_world, project_camera
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.render import draw_mesh
from imocap_core.render.arrays import Floats, Image
from imocap_core.synthetic.cameras import FilmCamera, Viewpoint
from imocap_core.synthetic.captured import place_camera
from imocap_core.synthetic.embodied import Embodied
from imocap_core.synthetic.hall import hall
from imocap_core.synthetic.performer import outfit
from imocap_core.synthetic.scene import backdrop, cast_shadow, render_plate

SENSOR_NOISE = 2.0  # grey levels
SKIN_CHUNK = 16  # frames skinned together
SIDEWAYS = 0.5  # cosine of the angle between where one faces and the camera: 60 degrees
FLOOR_QUANTILE = 0.1  # soles are on the floor at least that often


@dataclass(frozen=True)
class Shooting:
    """A motion and a fixed camera. joints (T, 24, 3) metres, z up, floor at 0; K (3, 3); R (3, 3),
    t (3,) camera from world; floor_m: how high the floor lay in the axes of the motion."""

    motion: Embodied
    joints: Floats
    K: Floats
    R: Floats
    t: Floats
    size: tuple[int, int]
    azimuth_deg: float
    floor_m: float


def shoot(motion: Embodied, shaped: Shaped, view: Viewpoint, size: tuple[int, int]) -> Shooting:
    """Set a motion on the floor and a camera before it that sees all of it."""
    vertices = np.stack(list(_skinned(motion, shaped)))
    floor = float(np.quantile(vertices[..., 2].min(axis=1), FLOOR_QUANTILE))
    down = np.array([0.0, 0.0, floor])
    standing = Embodied(motion.R_local, motion.transl - down)
    K, R, t = place_camera(view, vertices[:, ::50] - down, size)
    posed = shaped.pose(torch.as_tensor(standing.R_local), torch.as_tensor(standing.transl))
    joints = posed.joints.numpy()
    return Shooting(standing, joints, K, R, t, size, view.azimuth_deg, floor)


def true_points_px(shooting: Shooting, shaped: Shaped, layout: str) -> tuple[Floats, Floats]:
    """Where a layout's points on this body are seen, (T, K, 2) pixels, and their depths (T, K)."""
    motion = shooting.motion
    posed = shaped.pose(torch.as_tensor(motion.R_local), torch.as_tensor(motion.transl))
    points = posed.keypoints(shaped.model.points(layout)).numpy()
    in_camera = camera_from_world(points, shooting.R, shooting.t)
    return project_camera(in_camera, shooting.K), in_camera[..., 2]


def seen_from(joints: Floats, R: Floats, t: Floats) -> str:
    """What a camera sees of joints (T, 24, 3), z up, in most frames: front, side or back."""
    left, right = (SMPL_JOINTS.index(f"{side}_hip") for side in ("left", "right"))
    across = joints[:, left, :2] - joints[:, right, :2]
    ahead = np.stack([across[:, 1], -across[:, 0]], axis=1)  # across x up
    towards = (-R.T @ t)[:2] - joints[:, 0, :2]
    cosine = (ahead * towards).sum(axis=1) / (
        np.linalg.norm(ahead, axis=1) * np.linalg.norm(towards, axis=1)
    )
    middle = float(np.median(cosine))
    return "front" if middle > SIDEWAYS else "back" if middle < -SIDEWAYS else "side"


def film_frames(shooting: Shooting, shaped: Shaped, kind: int, seed: int) -> Iterator[Image]:
    """The pictures in order, RGB (H, W, 3) uint8: a hall of a kind, shadow, performer, noise."""
    model = shaped.model
    if model.face_parts is None:
        raise ValueError(f"body model {model.name} has no face_parts: nothing to dress")
    clothes, grain = (np.random.default_rng([seed, kind, part]) for part in range(2))
    colors = outfit(model.face_parts.numpy(), model.part_names, clothes)
    faces = model.faces.numpy().astype(np.int64)
    K, R, t, (width, height) = shooting.K, shooting.R, shooting.t, shooting.size
    frames = len(shooting.joints)
    camera = FilmCamera(K, np.broadcast_to(R, (frames, 3, 3)), np.broadcast_to(t, (frames, 3)))
    path = shooting.joints.reshape(-1, 3)
    surfaces = hall(kind, shooting.azimuth_deg, path, camera.centre, seed)
    room = backdrop(render_plate(surfaces, camera, shooting.size), K, R, shooting.size)
    noise = grain.normal(0.0, SENSOR_NOISE, (2 * height, 2 * width, 1)).astype(np.float32)
    for vertices in _skinned(shooting.motion, shaped):
        image = cast_shadow(room, vertices, K, R, t)
        image = draw_mesh(image, vertices, faces, colors, K, R, t)
        y, x = grain.integers(height), grain.integers(width)
        noisy = image + noise[y : y + height, x : x + width]
        yield np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def _skinned(motion: Embodied, shaped: Shaped) -> Iterator[Floats]:
    """World vertices (V, 3) of each frame."""
    rotations, transl = torch.as_tensor(motion.R_local), torch.as_tensor(motion.transl)
    for start in range(0, len(transl), SKIN_CHUNK):
        part = slice(start, start + SKIN_CHUNK)
        yield from shaped.pose(rotations[part], transl[part]).mesh().vertices.numpy()

"""A body's motion rendered as a video: room, camera, clothes, and the ground truth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, UInt8

from benchmarks.synthetic.captured import place_camera
from benchmarks.synthetic.large_room import large_room
from benchmarks.synthetic.performers import RetargetedMotion
from imocap_core.body import Shaped
from imocap_core.camera.projection import camera_from_world, project_camera
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.render import draw_mesh
from imocap_core.synthetic.cameras import CameraPlacement, FilmCamera
from imocap_core.synthetic.choreography import outfit
from imocap_core.synthetic.rooms import backdrop, cast_shadow, render_plate

SENSOR_NOISE = 2.0  # grey levels
SKIN_CHUNK = 16  # frames skinned together
SIDEWAYS = 0.5  # cosine of the angle between facing direction and camera: 60 degrees
FLOOR_QUANTILE = 0.1  # the soles are on the floor in at least this share of the frames


@dataclass(frozen=True)
class FilmedMotion:
    """A motion and a static camera (R, t: camera from world).

    joints: metres, z up, floor at 0. floor_m: height of the floor in the axes of the given motion.
    """

    motion: RetargetedMotion
    joints: Float[np.ndarray, "T 24 3"]
    K: Float[np.ndarray, "3 3"]
    R: Float[np.ndarray, "3 3"]
    t: Float[np.ndarray, "3"]
    size: tuple[int, int]
    azimuth_deg: float
    floor_m: float


def film_motion(
    motion: RetargetedMotion, shaped: Shaped, view: CameraPlacement, size: tuple[int, int]
) -> FilmedMotion:
    """A motion moved onto the floor, and a camera that has all of it in view."""
    vertices = np.stack(list(_skinned(motion, shaped)))
    floor = float(np.quantile(vertices[..., 2].min(axis=1), FLOOR_QUANTILE))
    down = np.array([0.0, 0.0, floor])
    on_floor = RetargetedMotion(motion.R_local, motion.transl - down)
    K, R, t = place_camera(view, vertices[:, ::50] - down, size)
    posed = shaped.pose(torch.as_tensor(on_floor.R_local), torch.as_tensor(on_floor.transl))
    joints = posed.joints.numpy()
    return FilmedMotion(on_floor, joints, K, R, t, size, view.azimuth_deg, floor)


def true_points_px(
    filmed: FilmedMotion, shaped: Shaped, layout: str
) -> tuple[Float[np.ndarray, "T K 2"], Float[np.ndarray, "T K"]]:
    """True pixels of a layout's keypoints on this body, and their depths in metres."""
    motion = filmed.motion
    posed = shaped.pose(torch.as_tensor(motion.R_local), torch.as_tensor(motion.transl))
    points = posed.keypoints(shaped.model.points(layout)).numpy()
    in_camera = camera_from_world(points, filmed.R, filmed.t)
    return project_camera(in_camera, filmed.K), in_camera[..., 2]


def viewed_side(
    joints: Float[np.ndarray, "T 24 3"], R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]
) -> str:
    """The side of a body (z up) that faces the camera in most frames: front, side or back."""
    left, right = (SMPL_JOINTS.index(f"{side}_hip") for side in ("left", "right"))
    across = joints[:, left, :2] - joints[:, right, :2]
    ahead = np.stack([across[:, 1], -across[:, 0]], axis=1)  # across x up
    towards = (-R.T @ t)[:2] - joints[:, 0, :2]
    cosine = (ahead * towards).sum(axis=1) / (
        np.linalg.norm(ahead, axis=1) * np.linalg.norm(towards, axis=1)
    )
    middle = float(np.median(cosine))
    return "front" if middle > SIDEWAYS else "back" if middle < -SIDEWAYS else "side"


def render_frames(
    filmed: FilmedMotion, shaped: Shaped, kind: int, seed: int
) -> Iterator[UInt8[np.ndarray, "H W 3"]]:
    """The RGB frames in order: a room (kind 0 to 3), shadow, performer, sensor noise."""
    model = shaped.model
    if model.face_parts is None:
        raise ValueError(f"body model {model.name} has no face_parts: nothing to dress")
    clothes, grain = (np.random.default_rng([seed, kind, part]) for part in range(2))
    colors = outfit(model.face_parts.numpy(), model.part_names, clothes)
    faces = model.faces.numpy().astype(np.int64)
    K, R, t, (width, height) = filmed.K, filmed.R, filmed.t, filmed.size
    frames = len(filmed.joints)
    camera = FilmCamera(K, np.broadcast_to(R, (frames, 3, 3)), np.broadcast_to(t, (frames, 3)))
    path = filmed.joints.reshape(-1, 3)
    surfaces = large_room(kind, filmed.azimuth_deg, path, camera.centre, seed)
    room = backdrop(render_plate(surfaces, camera, filmed.size), K, R, filmed.size)
    noise = grain.normal(0.0, SENSOR_NOISE, (2 * height, 2 * width, 1)).astype(np.float32)
    for vertices in _skinned(filmed.motion, shaped):
        image = cast_shadow(room, vertices, K, R, t)
        image = draw_mesh(image, vertices, faces, colors, K, R, t)
        y, x = grain.integers(height), grain.integers(width)
        noisy = image + noise[y : y + height, x : x + width]
        yield np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def _skinned(motion: RetargetedMotion, shaped: Shaped) -> Iterator[Float[np.ndarray, "V 3"]]:
    """World vertices of each frame."""
    rotations, transl = torch.as_tensor(motion.R_local), torch.as_tensor(motion.transl)
    for start in range(0, len(transl), SKIN_CHUNK):
        part = slice(start, start + SKIN_CHUNK)
        yield from shaped.pose(rotations[part], transl[part]).mesh().vertices.numpy()

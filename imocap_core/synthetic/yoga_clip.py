"""A take: one performance, filmed by one camera, seen by the detector. And its pictures."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch

from imocap_core.body import Shaped
from imocap_core.camera.projection import camera_from_world, project_camera
from imocap_core.render import draw_mesh
from imocap_core.render.arrays import Floats, Image
from imocap_core.synthetic.cameras import YOGA_VIEWPOINTS, FilmCamera, film, standing_height_px
from imocap_core.synthetic.detector import Detections, detect
from imocap_core.synthetic.performer import contact_forward, outfit
from imocap_core.synthetic.scene import backdrop, cast_shadow, render_plate, room
from imocap_core.synthetic.strangers import strangers
from imocap_core.synthetic.variation import Clip, Performance, perform
from imocap_core.synthetic.yoga import SUN_SALUTATION

SIZE = (640, 360)
LAYOUT = "body25"

# No two clips start, end, last or tick alike.
YOGA_CLIPS: tuple[Clip, ...] = (
    Clip(frames=168, first=4.0, last=176.0, fps=30.0),
    Clip(frames=186, first=0.0, last=170.0, fps=30.0),
    Clip(frames=146, first=9.0, last=180.0, fps=25.0),
    Clip(frames=158, first=2.0, last=165.0, fps=30.0),
)
_SENSOR_NOISE = 2.0  # grey levels
_SKIN_CHUNK = 16  # frames skinned together
_BETA_SPREAD = 0.5


@dataclass(frozen=True)
class HandTake:
    """Both hands, left first: points_m (T, 2, 21, 3) in the world, and what a detector said."""

    points_m: Floats
    detections: Detections  # xy_px (T, 2, 21, 2), confidence (T, 2, 21)


@dataclass(frozen=True)
class Take:
    """Everything true about one video, and what the detector said about it.

    joints (T, 24, 3) world metres (z up); xy_px (T, 25, 2) true keypoints; transl (T, 3) of the
    body model; strangers: the false second person of each frame, or None.
    """

    fps: float
    size: tuple[int, int]
    performance: Performance
    transl: Floats
    joints: Floats
    camera: FilmCamera
    xy_px: Floats
    detections: Detections
    strangers: list[Detections | None]
    azimuth_deg: float
    hands: HandTake | None = None


def draw_betas(seed: int, count: int) -> Floats:
    """Shape (count,) of the one performer of a seed."""
    return np.random.default_rng([seed, 0]).normal(0.0, _BETA_SPREAD, count)


def yoga_take(seed: int, index: int, shaped: Shaped) -> Take:
    """Video `index` (0 to 3) of the yoga action. shaped: a body with coefficients (n,)."""
    clip, view = YOGA_CLIPS[index], YOGA_VIEWPOINTS[index]
    # own streams, so that a change in one part of the take leaves the others as they were
    motion_rng, camera_rng, detector_rng = (
        np.random.default_rng([seed, 1, index, part]) for part in range(3)
    )
    joints_rest = shaped.joints_rest.numpy()
    sole_height = float(shaped.vertices_rest[:, 1].min())
    forward = contact_forward(shaped)
    performance = perform(SUN_SALUTATION, clip, forward, joints_rest, sole_height, motion_rng)
    transl = performance.pelvis - joints_rest[0]
    posed = shaped.pose(torch.as_tensor(performance.R_local), torch.as_tensor(transl))
    camera = film(view, performance.pelvis, clip.fps, SIZE, camera_rng)

    points = shaped.model.points(LAYOUT)
    in_camera = camera_from_world(
        posed.keypoints(points).numpy(), camera.R_cam_from_world, camera.t[:, None]
    )
    xy_px = project_camera(in_camera, camera.K)
    height_px = standing_height_px(shaped, camera.K[1, 1], in_camera[..., 2])
    detections = detect(xy_px, height_px, points.names, clip.fps, detector_rng)
    others = strangers(detections, SIZE, detector_rng)
    joints = posed.joints.numpy()
    return Take(
        clip.fps,
        SIZE,
        performance,
        transl,
        joints,
        camera,
        xy_px,
        detections,
        others,
        view.azimuth_deg,
    )


def pictures(take: Take, seed: int, index: int, shaped: Shaped) -> Iterator[Image]:
    """The frames of a take in order, RGB (H, W, 3) uint8: room, shadow, performer, sensor noise."""
    scene_rng, grain_rng = (np.random.default_rng([seed, 2, index, part]) for part in range(2))
    clothes_rng = np.random.default_rng([seed, 3, index])
    model = shaped.model
    if model.face_parts is None:
        raise ValueError(f"body model {model.name} has no face_parts: nothing to dress")
    colors = outfit(model.face_parts.numpy(), model.part_names, clothes_rng)
    faces = model.faces.numpy().astype(np.int64)
    camera = take.camera
    surfaces = room(index, take.azimuth_deg, scene_rng)
    plate = render_plate(surfaces, camera, take.size)
    width, height = take.size
    grain = grain_rng.normal(0.0, _SENSOR_NOISE, (2 * height, 2 * width, 1)).astype(np.float32)
    for frame, vertices in enumerate(_skinned(take, shaped)):
        R, t = camera.R_cam_from_world[frame], camera.t[frame]
        image = backdrop(plate, camera.K, R, take.size)
        image = cast_shadow(image, vertices, camera.K, R, t)
        image = draw_mesh(image, vertices, faces, colors, camera.K, R, t)
        y, x = grain_rng.integers(height), grain_rng.integers(width)
        noisy = image + grain[y : y + height, x : x + width]
        yield np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def _skinned(take: Take, shaped: Shaped) -> Iterator[Floats]:
    """World vertices (V, 3) of each frame."""
    rotations = torch.as_tensor(take.performance.R_local)
    transl = torch.as_tensor(take.transl)
    for start in range(0, len(transl), _SKIN_CHUNK):
        part = slice(start, start + _SKIN_CHUNK)
        yield from shaped.pose(rotations[part], transl[part]).mesh().vertices.numpy()

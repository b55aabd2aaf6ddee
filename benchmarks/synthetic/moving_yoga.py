"""Cameras that leave their place: carried by somebody who walks, or moved along a path."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, UInt8
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from benchmarks.synthetic.films import furniture
from imocap_core.body import Shaped
from imocap_core.camera.projection import camera_from_world, intrinsics, project_camera
from imocap_core.camera.zooming import lens_of
from imocap_core.render import draw_mesh
from imocap_core.synthetic import cameras
from imocap_core.synthetic.choreography import outfit
from imocap_core.synthetic.detector import Detections, detect
from imocap_core.synthetic.rooms import cast_shadow, raycast, room
from imocap_core.synthetic.yoga_clip import LAYOUT, DemoClip, make_yoga_clip

FOLLOW_S = 0.35  # how slowly the operator follows
STEP_HZ = 1.8  # steps a second of somebody who walks
BOB_M = 0.02  # rise and fall of a carried camera
SHAKE_KNOT_S = 0.4


@dataclass(frozen=True)
class CameraWalk:
    """How far a camera moves from the place of a `CameraPlacement` over a video.

    Attributes:
        sideways_m: along the circle about the performer; ahead_m: towards the performer.
        shake_deg: unsteadiness of the hand (standard deviation of pan); bob: whether the camera
            rises and falls with the steps.
        bend: 0 walks at an even pace; 1 walks there and back.
    """

    sideways_m: float
    ahead_m: float = 0.0
    shake_deg: float = 0.5
    bob: bool = True
    bend: float = 0.0


def walk_camera(
    view: cameras.CameraPlacement,
    walk: CameraWalk,
    path: Float[np.ndarray, "T 3"],
    fps: float,
    size: tuple[int, int],
    rng: np.random.Generator,
) -> cameras.FilmCamera:
    """A camera that walks while it is aimed at a performer whose pelvis moves along a path."""
    frames = len(path)
    middle = np.append(np.median(path[:, :2], axis=0), view.aim_height_m)
    share = _progress(frames, walk.bend)
    azimuth = np.deg2rad(view.azimuth_deg) + walk.sideways_m * share / view.distance_m
    radius = view.distance_m - walk.ahead_m * share
    outward = np.stack([np.sin(azimuth), -np.cos(azimuth), np.zeros(frames)], axis=1)
    height = np.full(frames, view.height_m)
    if walk.bob:
        height += BOB_M * np.sin(2 * np.pi * STEP_HZ * np.arange(frames) / fps + rng.uniform(0, 6))
    centre = middle * (1, 1, 0) + radius[:, None] * outward
    centre[:, 2] = height
    slow = gaussian_filter1d(path, FOLLOW_S * fps, axis=0, mode="nearest")
    target = middle + view.follow * (slow - middle)
    shake = _shake(frames, fps, walk.shake_deg, rng)
    R = np.stack(
        [
            cameras.look_at(c, aim, view.roll_deg + s[2], s[:2])
            for c, aim, s in zip(centre, target, shake, strict=True)
        ]
    )
    t = -np.einsum("tij,tj->ti", R, centre)
    return cameras.FilmCamera(intrinsics(view.focal_per_width * size[0], size), R, t)


def _progress(frames: int, bend: float) -> Float[np.ndarray, " T"]:
    """From 0 to 1, or to 1 and back, with a soft start and end."""
    even = np.linspace(0.0, 1.0, frames)
    there = even**2 * (3 - 2 * even)
    return (1 - bend) * there + bend * np.sin(np.pi * even) ** 2


def _shake(
    frames: int, fps: float, sigma_deg: float, rng: np.random.Generator
) -> Float[np.ndarray, "T 3"]:
    """Smooth random pan, tilt and roll, degrees."""
    knots = max(4, round(frames / fps / SHAKE_KNOT_S) + 2)
    values = sigma_deg * np.clip(rng.normal(size=(knots, 3)), -2, 2) * (1.0, 0.7, 0.4)
    return CubicSpline(np.linspace(0, frames - 1, knots), values)(np.arange(frames))


# Yoga filmed by a camera that walks about the performer, in a furnished room.

BOXES = 6
RAYS = 1  # a pixel, in each direction
_GRAIN = 2.0  # grey levels


def make_moving_clip(
    seed: int, index: int, shaped: Shaped, walk: CameraWalk, size: tuple[int, int]
) -> DemoClip:
    """Video `index` of yoga, filmed by a camera that walks."""
    still = make_yoga_clip(seed, index, shaped)
    camera_rng, detector_rng = (np.random.default_rng([seed, 4, index, part]) for part in range(2))
    view = replace(cameras.YOGA_CAMERAS[index], follow=0.75, wander_deg=0.0)
    camera = walk_camera(view, walk, still.motion.pelvis, still.fps, size, camera_rng)
    posed = shaped.pose(torch.as_tensor(still.R_smpl), torch.as_tensor(still.transl))
    points = shaped.model.points(LAYOUT)
    in_camera = camera_from_world(
        posed.keypoints(points).numpy(), camera.R_cam_from_world, camera.t[:, None]
    )
    xy_px = project_camera(in_camera, camera.K)
    height_px = cameras.stature_px(shaped, camera.K[1, 1], in_camera[..., 2])
    detections = detect(xy_px, height_px, points.names, still.fps, detector_rng)
    nobody: list[Detections | None] = [None] * len(xy_px)
    return replace(
        still, size=size, camera=camera, xy_px=xy_px, detections=detections, false_people=nobody
    )


def every_frame(clip: DemoClip, stride: int) -> DemoClip:
    """Every ``stride``-th frame of a clip's camera, body and true points, at a lower frame rate."""
    camera = clip.camera
    return replace(
        clip,
        fps=clip.fps / stride,
        transl=clip.transl[::stride],
        R_smpl=clip.R_smpl[::stride],
        joints=clip.joints[::stride],
        camera=cameras.FilmCamera(camera.K, camera.R_cam_from_world[::stride], camera.t[::stride]),
        xy_px=clip.xy_px[::stride],
    )


def moving_pictures(
    clip: DemoClip,
    seed: int,
    index: int,
    shaped: Shaped,
    zoom: Float[np.ndarray, " T"] | None = None,
) -> Iterator[UInt8[np.ndarray, "H W 3"]]:
    """The RGB frames of a clip in order, the room ray-cast anew for every place of the camera.

    zoom: of each frame, over the camera's focal length; None: it does not zoom.
    """
    scene_rng, box_rng, grain, clothes = (
        np.random.default_rng([seed, 5, index, part]) for part in range(4)
    )
    model = shaped.model
    if model.face_parts is None:
        raise ValueError(f"body model {model.name} has no face_parts: nothing to dress")
    colors = outfit(model.face_parts.numpy(), model.part_names, clothes)
    faces = model.faces.numpy().astype(np.int64)
    surfaces = room(index, clip.azimuth_deg, scene_rng)
    surfaces += furniture(clip.azimuth_deg, BOXES, box_rng)
    camera, centres = clip.camera, clip.camera.centres
    lenses = lens_of(camera.K, np.ones(len(centres)) if zoom is None else zoom)
    rows = zip(lenses, camera.R_cam_from_world, camera.t, strict=True)
    for frame, (K, R, t) in enumerate(rows):
        posed = shaped.pose(
            torch.as_tensor(clip.R_smpl[frame]), torch.as_tensor(clip.transl[frame])
        )
        vertices = posed.mesh().vertices.numpy()
        image = raycast(surfaces, K, R, centres[frame], clip.size, RAYS)
        image = cast_shadow(image, vertices, K, R, t)
        image = draw_mesh(image, vertices, faces, colors, K, R, t)
        noisy = image + grain.normal(0.0, _GRAIN, image.shape)
        yield np.clip(np.rint(noisy), 0, 255).astype(np.uint8)

"""Yoga filmed by a camera that walks about the performer, in a furnished room."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float, UInt8

from benchmarks.synthetic.furniture import furniture
from benchmarks.synthetic.walking_cameras import CameraWalk, walk_camera
from imocap_core.body import Shaped
from imocap_core.camera.projection import camera_from_world, project_camera
from imocap_core.camera.zooming import lens_of
from imocap_core.render import draw_mesh
from imocap_core.synthetic.cameras import YOGA_CAMERAS, FilmCamera, stature_px
from imocap_core.synthetic.choreography import outfit
from imocap_core.synthetic.detector import Detections, detect
from imocap_core.synthetic.rooms import cast_shadow, raycast, room
from imocap_core.synthetic.yoga_clip import LAYOUT, DemoClip, make_yoga_clip

BOXES = 6
RAYS = 1  # a pixel, in each direction
_GRAIN = 2.0  # grey levels


def make_moving_clip(
    seed: int, index: int, shaped: Shaped, walk: CameraWalk, size: tuple[int, int]
) -> DemoClip:
    """Video `index` of yoga, filmed by a camera that walks."""
    still = make_yoga_clip(seed, index, shaped)
    camera_rng, detector_rng = (np.random.default_rng([seed, 4, index, part]) for part in range(2))
    view = replace(YOGA_CAMERAS[index], follow=0.75, wander_deg=0.0)
    camera = walk_camera(view, walk, still.motion.pelvis, still.fps, size, camera_rng)
    posed = shaped.pose(torch.as_tensor(still.R_smpl), torch.as_tensor(still.transl))
    points = shaped.model.points(LAYOUT)
    in_camera = camera_from_world(
        posed.keypoints(points).numpy(), camera.R_cam_from_world, camera.t[:, None]
    )
    xy_px = project_camera(in_camera, camera.K)
    height_px = stature_px(shaped, camera.K[1, 1], in_camera[..., 2])
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
        camera=FilmCamera(camera.K, camera.R_cam_from_world[::stride], camera.t[::stride]),
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

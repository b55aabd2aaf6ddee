"""Made actions of any size: slow sun salutations, simulated detections, films of the room alone.

The films are for `camera_motion`, which looks at the background, and for the figures; drawing the
performer into thousands of frames would take longer than what is measured.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import yaml
from jaxtyping import Float, UInt8

from benchmarks.actions.action_folder import action_key, make_filmed
from imocap_core.body import Posed, Shaped
from imocap_core.camera.projection import camera_from_world, project_camera
from imocap_core.io.video import write_h264
from imocap_core.pipeline.make_demo import demo_body, video_id, write_keypoints
from imocap_core.pipeline.source import closure
from imocap_core.synthetic.cameras import CameraPlacement, FilmCamera, aim_camera, stature_px
from imocap_core.synthetic.choreography import PhaseSpan, contact_forward, perform
from imocap_core.synthetic.detector import detect, false_people
from imocap_core.synthetic.rooms import backdrop, render_plate, room
from imocap_core.synthetic.yoga import SUN_SALUTATION
from imocap_core.synthetic.yoga_clip import LAYOUT, SIZE, DemoClip

FPS, CRF, SEED = 30.0, 20, 7
PHASES = ((0.0, 9.0), (165.0, 180.0))  # at which a video begins and ends
TURN_DEG = 85.0  # between the cameras of two videos
NOISE, ROOMS = 2.0, 4  # grey levels; kinds of rooms


@dataclass(frozen=True)
class ActionSize:
    """Videos of so many frames each, with keypoints of a layout."""

    videos: int
    frames: int
    layout: str = "body25"

    @property
    def name(self) -> str:
        """Of the action."""
        return f"{self.videos}x{self.frames}-{self.layout}"


def make_sized_action(folder: Path, size: ActionSize) -> None:
    """Write the action into `folder` unless the same code made it; complete or not at all."""
    key = action_key([closure(Path(__file__)), size.name, SEED], [])
    make_filmed(folder, key, lambda new: _write(new, folder.name, size))


def _write(folder: Path, name: str, size: ActionSize) -> None:
    shaped = demo_body(SEED)
    declared = [_write_video(folder, size, index, shaped) for index in range(size.videos)]
    action = {"name": name, "videos": declared}
    (folder / "action.yaml").write_text(yaml.safe_dump(action, sort_keys=False))


def _write_video(folder: Path, size: ActionSize, index: int, shaped: Shaped) -> dict[str, Any]:
    """Keypoints and film of one video; its entry in action.yaml."""
    name = video_id(index)
    clip = made_clip(size, index, shaped)
    write_keypoints(folder / "keypoints" / name, name, clip)
    write_h264(folder / "videos" / f"{name}.mp4", _pictures(clip, index), clip.fps, crf=CRF)
    return {
        "id": name,
        "video": f"videos/{name}.mp4",
        "keypoints": f"keypoints/{name}",
        "format": "openpose",
        "layout": size.layout,
    }


def made_clip(size: ActionSize, index: int, shaped: Shaped) -> DemoClip:
    """The performance that one video shows, and its detections; every second camera turns."""
    rng = np.random.default_rng([SEED, 5, index, size.videos, size.frames])
    first, last = (float(rng.uniform(*span)) for span in PHASES)
    span = PhaseSpan(frames=size.frames, first=first, last=last, fps=FPS)
    joints_rest = shaped.joints_rest.numpy()
    sole_height = float(shaped.vertices_rest[:, 1].min())
    forward = contact_forward(shaped)
    motion = perform(SUN_SALUTATION, span, forward, joints_rest, sole_height, rng)
    transl = motion.pelvis - joints_rest[0]
    posed = shaped.pose(torch.as_tensor(motion.R_local), torch.as_tensor(transl))
    view = _placement(index, rng)
    camera = aim_camera(view, motion.pelvis, FPS, SIZE, rng)
    in_camera, xy_px = _seen(posed, camera, LAYOUT)
    height_px = stature_px(shaped, camera.K[1, 1], in_camera[..., 2])
    names = shaped.model.points(size.layout).names
    detections = detect(_seen(posed, camera, size.layout)[1], height_px, names, FPS, rng)
    others = false_people(detections, SIZE, rng)
    return DemoClip(
        fps=FPS,
        size=SIZE,
        motion=motion,
        transl=transl,
        R_smpl=motion.R_local,
        joints=posed.joints.numpy(),
        camera=camera,
        xy_px=xy_px,
        detections=detections,
        false_people=others,
        azimuth_deg=view.azimuth_deg,
    )


def _seen(
    posed: Posed, camera: FilmCamera, layout: str
) -> tuple[Float[np.ndarray, "T K 3"], Float[np.ndarray, "T K 2"]]:
    """A layout's points in the camera's axes, metres, and in the picture, pixels."""
    xyz = posed.keypoints(posed.shaped.model.points(layout)).numpy()
    in_camera = camera_from_world(xyz, camera.R_cam_from_world, camera.t[:, None])
    return in_camera, project_camera(in_camera, camera.K)


def _placement(index: int, rng: np.random.Generator) -> CameraPlacement:
    turns = index % 2 == 1
    return CameraPlacement(
        azimuth_deg=(38.0 + TURN_DEG * index) % 360.0,
        distance_m=rng.uniform(3.8, 5.5),
        height_m=rng.uniform(0.9, 2.0),
        focal_per_width=rng.uniform(0.85, 1.15),
        follow=0.75 if turns else 0.0,
        wander_deg=2.6 if turns else 0.0,
        roll_deg=rng.uniform(-1.0, 1.0),
    )


def _pictures(clip: DemoClip, index: int) -> Iterator[UInt8[np.ndarray, "H W 3"]]:
    """The room as the camera sees it, with sensor noise."""
    scene_rng, grain_rng = (np.random.default_rng([SEED, 6, index, part]) for part in range(2))
    plate = render_plate(room(index % ROOMS, clip.azimuth_deg, scene_rng), clip.camera, clip.size)
    width, height = clip.size
    grain = grain_rng.normal(0.0, NOISE, (2 * height, 2 * width, 1)).astype(np.float32)
    for R in clip.camera.R_cam_from_world:
        y, x = grain_rng.integers(height), grain_rng.integers(width)
        noisy = backdrop(plate, clip.camera.K, R, clip.size) + grain[y : y + height, x : x + width]
        yield np.clip(np.rint(noisy), 0, 255).astype(np.uint8)

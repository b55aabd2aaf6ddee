"""The recovered body from front, side and back at several phases, beside the pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from jaxtyping import Float
from matplotlib.figure import Figure

from imocap_core import rotations
from imocap_core.artifacts.schemas import Camera, RefineSync
from imocap_core.body import Model
from imocap_core.camera.ground import upright_alignment
from imocap_core.camera.world import GroundAlignment
from imocap_core.figures.bodies import surfaces
from imocap_core.figures.contact_sheets import SheetVideo
from imocap_core.figures.overlays import CELL_PX, Image, blank_cell, contact_sheet
from imocap_core.problem.ground import ground_of
from imocap_core.render.body_views import (
    UP,
    VIEWS,
    common_scale,
    draw_view,
    heading_of,
    segment_colors,
)

ARMS_DOWN_RAD = 1.1  # of the rest pose beside the phases
CAPTION = (
    "The recovered body of {video} from its front, its right side and its back. The first "
    "column is the same body at rest. The colours are the torso's segments: in an upright pose "
    "each band should be as wide as at rest. A band that is wider or that stands out is a "
    "ballooned chest, one that vanishes is a creased waist. The thin line is the ground."
)


def sheet_ids(refined: RefineSync, videos: Sequence[SheetVideo]) -> list[str]:
    """The reference, and of the other videos of the action the one that fits its picture worst.

    The fit is the median reprojection error relative to the size of the person in the picture.
    """
    sync = refined.sync
    misfit = {
        video.keypoints.id: _relative_misfit(video)
        for video in videos
        if video.keypoints.id not in (sync.reference, *sync.excluded)
    }
    return [sync.reference, *sorted(misfit, key=lambda name: -misfit[name])[:1]]


def upright_world(refined: RefineSync) -> GroundAlignment:
    """The world with y up and the ground at 0; without a ground, up is the reference camera's."""
    motion = refined.motion
    if motion.ground is None:
        return GroundAlignment(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
    camera = next(c for c in motion.cameras if c.id == motion.reference)
    return upright_alignment(ground_of(motion.ground), camera.R, "y")


def body_sheet(
    video: SheetVideo,
    camera: Camera,
    ground: GroundAlignment,
    model: Model,
    frames: Sequence[int],
    cells: Mapping[int, Image],
) -> Figure:
    """A column for the body at rest and one for each of `frames` (indices); a row for the pictures
    and one for each view.

    camera: that of the video in the final result. cells: index of a frame -> its picture, or
    its detections where there is none.
    """
    motion = video.final
    R_upright_from_cam = ground.R_upright_from_world @ camera.R.T
    in_world = (surfaces(model, motion, frames) - camera.t) @ camera.R
    posed = in_world @ ground.R_upright_from_world.T + ground.t
    R_root = rotations.exp(torch.from_numpy(motion.theta[list(frames), :3])).numpy()
    bodies = np.concatenate([_at_rest(model, motion.betas)[None], posed])
    headings = np.stack([heading_of(R) for R in (np.eye(3), *(R_upright_from_cam @ R_root))])

    faces = model.faces.numpy()
    colors = segment_colors(model.weights.numpy(), model.joint_names, faces)
    px_per_m = common_scale(bodies, headings, CELL_PX)
    views = [
        [
            draw_view(body, faces, colors, heading, view, CELL_PX, px_per_m)
            for body, heading in zip(bodies, headings, strict=True)
        ]
        for view in VIEWS
    ]
    return contact_sheet(
        [[blank_cell(), *(cells[t] for t in frames)], *views],
        ["picture", *VIEWS],
        ["at rest", *(f"frame {video.keypoints.frames[t]}" for t in frames)],
        f"The recovered body of {motion.id}",
        "blue: pelvis, yellow: spine1, green: spine2, red: spine3, violet: collars; "
        "upright, the bands should be as wide as at rest",
    )


def _at_rest(model: Model, betas: Float[np.ndarray, " B"]) -> Float[np.ndarray, "V 3"]:
    """The body's surface with its arms lowered, on the ground of the upright world."""
    theta = torch.zeros(len(model.joint_names), 3, dtype=torch.float64)
    for name, sign in (("left_shoulder", -1.0), ("right_shoulder", 1.0)):
        theta[model.joint_names.index(name), 2] = sign * ARMS_DOWN_RAD
    shaped = model.shape(torch.from_numpy(betas))
    posed = shaped.pose(rotations.exp(theta), torch.zeros(3, dtype=torch.float64))
    vertices = posed.mesh().vertices.numpy()
    return np.asarray(vertices - vertices[:, 1].min() * UP)


def _relative_misfit(video: SheetVideo) -> float:
    """Median reprojection error over the median height of the person's box; 0 where unknown."""
    motion, box = video.final, video.keypoints.person_box_px
    height_px = box[:, 3] - box[:, 1]
    shown = np.isfinite(motion.reprojection_px) & np.isfinite(height_px)
    if not shown.any():
        return 0.0
    return float(np.median(motion.reprojection_px[shown]) / np.median(height_px[shown]))

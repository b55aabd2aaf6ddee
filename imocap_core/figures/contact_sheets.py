"""Contact sheets from the real videos: a sheet for each video, and one across all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from imocap_core.artifacts.schemas import (
    SyncMap,
    VideoCameraMotion,
    VideoKeypoints,
    VideoMotion,
)
from imocap_core.body import Model
from imocap_core.camera.zooming import lens_of
from imocap_core.figures.bodies import surfaces
from imocap_core.figures.overlays import (
    CELL_PX,
    PAPER_RGB,
    Image,
    Window,
    contact_sheet,
    draw_body,
    draw_keypoints,
    draw_skeleton,
    from_the_side,
    windows,
)
from imocap_core.io.video import read_rgb

Array = NDArray[np.float64]

COLUMNS = 6
GAP_FRAMES = 4.0
"""A moment of the reference farther than this from every matched frame has no picture."""


@dataclass(frozen=True)
class SheetVideo:
    """One video with all that is drawn over it."""

    seen: VideoKeypoints
    camera: VideoCameraMotion
    file: Path | None
    layout_names: tuple[str, ...]
    first: VideoMotion  # what this video alone says
    last: VideoMotion  # the final answer
    K: Array  # (3, 3) of the final answer


def spread(count: int, columns: int = COLUMNS) -> NDArray[np.int64]:
    """Indices of ``columns`` frames, evenly over ``count``, the very ends left out."""
    return np.unique(
        np.linspace(0.06 * (count - 1), 0.94 * (count - 1), columns).round().astype(int)
    )


def frames_of_moments(found: SyncMap, moments: ArrayLike) -> list[int | None]:
    """For each moment (index into the reference) the video's frame that shows it, or None."""
    at = found.reference_frame
    if not np.isfinite(at).any():
        return [None] * len(np.asarray(moments))
    first, last = np.nanmin(at) - 0.5, np.nanmax(at) + 0.5
    chosen: list[int | None] = []
    for moment in np.asarray(moments, dtype=np.float64):
        distance = np.abs(at - moment)
        nearest = int(np.nanargmin(distance))
        inside = first <= moment <= last and distance[nearest] <= GAP_FRAMES
        chosen.append(nearest if inside else None)
    return chosen


def read_cells(
    shot: SheetVideo, frames: Sequence[int]
) -> tuple[dict[int, Image], dict[int, Window]]:
    """The person cut out of the real frames (indices into the used frames); paper without video."""
    boxes = windows(shot.seen.person_box_px[list(frames)], shot.seen.size)
    where = dict(zip(frames, boxes, strict=True))
    paper: Image = np.full((CELL_PX[1], CELL_PX[0], 3), PAPER_RGB, dtype=np.uint8)
    cells = {t: paper.copy() for t in frames}
    if shot.file is not None:
        index = {int(shot.seen.frames[t]): t for t in frames}
        for number, picture in read_rgb(shot.file, min(index), max(index) + 1):
            if number in index:
                cells[index[number]] = where[index[number]].cut(picture)
    return cells, where


def video_sheet(
    shot: SheetVideo,
    model: Model,
    frames: Sequence[int],
    cells: dict[int, Image],
    where: dict[int, Window],
) -> Figure:
    """Detections, the monocular and the final body over the frames, and both from the side."""
    faces = model.faces.numpy()
    detected = [
        draw_keypoints(
            cells[t],
            where[t].points(shot.seen.xy_px[t]),
            shot.seen.confidence[t],
            shot.layout_names,
        )
        for t in frames
    ]
    rows = [detected]
    sides = []
    for motion, K in ((shot.first, shot.camera.K), (shot.last, shot.K)):
        in_first = surfaces(model, motion, frames)
        bodies = in_first @ shot.camera.R_first_from_frame[list(frames)]  # R^T x: axes of frame t
        rows.append(
            [
                draw_body(cells[t], body, faces, where[t].camera(lens_of(K, shot.camera.zoom[t])))
                for t, body in zip(frames, bodies, strict=True)
            ]
        )
        sides.append(from_the_side(bodies, faces))
    return contact_sheet(
        [*rows, *sides],
        [
            "detections",
            "monocular",
            "after loop",
            "monocular,\nfrom the side",
            "after loop,\nfrom the side",
        ],
        [f"frame {shot.seen.frames[t]}" for t in frames],
        shot.seen.id,
        "orange: the performer's left, blue: right; from the side: what the picture cannot show",
    )


def moment_cells(
    shot: SheetVideo,
    frames: Sequence[int | None],
    cells: dict[int, Image],
    where: dict[int, Window],
) -> list[Image]:
    """The final skeleton over the frames that stand for some moments; paper where there is none."""
    row = []
    for t in frames:
        if t is None:
            row.append(np.full((CELL_PX[1], CELL_PX[0], 3), PAPER_RGB, dtype=np.uint8))
            continue
        joints = shot.last.joints[t] @ shot.camera.R_first_from_frame[t]
        row.append(
            draw_skeleton(cells[t], joints, where[t].camera(lens_of(shot.K, shot.camera.zoom[t])))
        )
    return row

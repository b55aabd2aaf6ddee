"""Contact sheets of the videos' frames: one per video, and one across all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, Real
from matplotlib.figure import Figure

from imocap_core.artifacts.schemas import (
    CameraMotion,
    InitialSmpl,
    Keypoints,
    RefineSync,
    SyncMap,
    VideoCameraMotion,
    VideoKeypoints,
    VideoMotion,
)
from imocap_core.body import Model
from imocap_core.camera.lens import Lens
from imocap_core.camera.zooming import lens_of
from imocap_core.figures.bodies import surfaces
from imocap_core.figures.overlays import (
    Image,
    Window,
    blank_cell,
    contact_sheet,
    draw_body,
    draw_keypoints,
    draw_skeleton,
    from_the_side,
    windows,
)
from imocap_core.io.video import read_rgb_of
from imocap_core.problem.lenses import lenses_of
from imocap_core.problem.relative_motion import paths_of, paths_of_initial, relative_motions

COLUMNS = 6
GAP_FRAMES = 4.0
"""A moment of the reference further than this from every matched frame has no picture."""


@dataclass(frozen=True)
class SheetVideo:
    """One video with everything that is drawn over it."""

    keypoints: VideoKeypoints
    camera: VideoCameraMotion
    file: Path | None
    layout_names: tuple[str, ...]
    monocular: VideoMotion  # the estimate from this video alone
    final: VideoMotion
    K: Float[np.ndarray, "3 3"]  # of the final result
    lens: Lens | None = None

    def filmed(
        self, points_m: Float[np.ndarray, "N 3"], K: Float[np.ndarray, "3 3"]
    ) -> Float[np.ndarray, "N 3"]:
        """Points in camera axes, moved so that a pinhole camera K shows them as the lens does."""
        return points_m if self.lens is None else self.lens.bent(points_m, K)


def sheet_videos(
    keypoints: Keypoints,
    camera_motion: CameraMotion,
    initial: InitialSmpl,
    refined: RefineSync,
    files: Mapping[str, Path | None],
    model: Model,
) -> list[SheetVideo]:
    """Each video with its monocular and its final motion, relative to the place of its camera.

    files: video id -> its file.
    """
    alone = relative_motions(initial.videos, paths_of_initial(initial, camera_motion))
    joint = relative_motions(refined.motion.videos, paths_of(refined.motion.cameras))
    lenses = lenses_of(camera_motion, refined)
    return [
        SheetVideo(
            keypoints=video,
            camera=camera,
            file=files[video.id],
            layout_names=model.points(video.layout).names,
            monocular=first,
            final=last,
            K=solved.K,
            lens=lenses.get(video.id),
        )
        for video, camera, first, last, solved in zip(
            keypoints.videos,
            camera_motion.videos,
            alone,
            joint,
            refined.motion.cameras,
            strict=True,
        )
    ]


def spread(count: int, columns: int = COLUMNS) -> Int[np.ndarray, " _"]:
    """Indices of ``columns`` frames, evenly over ``count``, without the ends."""
    return np.unique(
        np.linspace(0.06 * (count - 1), 0.94 * (count - 1), columns).round().astype(int)
    )


def frames_of_moments(sync_map: SyncMap, moments: Real[np.ndarray, " N"]) -> list[int | None]:
    """For each moment (index into the reference) the video's frame that shows it, or None."""
    reference_frame = sync_map.reference_frame
    if not np.isfinite(reference_frame).any():
        return [None] * len(moments)
    first, last = np.nanmin(reference_frame) - 0.5, np.nanmax(reference_frame) + 0.5
    chosen: list[int | None] = []
    for moment in moments.astype(np.float64):
        distance = np.abs(reference_frame - moment)
        nearest = int(np.nanargmin(distance))
        inside = first <= moment <= last and distance[nearest] <= GAP_FRAMES
        chosen.append(nearest if inside else None)
    return chosen


def read_cells(
    video: SheetVideo, frames: Sequence[int]
) -> tuple[dict[int, Image], dict[int, Window]]:
    """Crops of the person in some used frames (indices), blank without a video file; and where
    they were cut."""
    keypoints = video.keypoints
    boxes = windows(keypoints.person_box_px[list(frames)], keypoints.size)
    cuts = dict(zip(frames, boxes, strict=True))
    cells = {t: blank_cell() for t in frames}
    if video.file is not None:
        source = {t: int(keypoints.frames[t]) for t in frames}
        for number, picture in read_rgb_of(video.file, set(source.values())):
            for t in (t for t in frames if source[t] == number):
                cells[t] = cuts[t].cut(picture)
    return cells, cuts


def detected_cells(
    video: SheetVideo,
    frames: Sequence[int],
    cells: Mapping[int, Image],
    cuts: Mapping[int, Window],
) -> dict[int, Image]:
    """The detections of each frame (index) over its cell."""
    keypoints = video.keypoints
    return {
        t: draw_keypoints(
            cells[t],
            cuts[t].points(keypoints.xy_px[t]),
            keypoints.confidence[t],
            video.layout_names,
        )
        for t in frames
    }


def video_sheet(
    video: SheetVideo,
    model: Model,
    frames: Sequence[int],
    cells: dict[int, Image],
    cuts: dict[int, Window],
) -> Figure:
    """Detections, monocular and final body over the frames, and both bodies from the side."""
    faces = model.faces.numpy()
    keypoints, camera = video.keypoints, video.camera
    detected = list(detected_cells(video, frames, cells, cuts).values())
    rows = [detected]
    sides = []
    for motion, K in ((video.monocular, camera.K), (video.final, video.K)):
        in_first = surfaces(model, motion, frames)
        bodies = in_first @ camera.R_first_from_frame[list(frames)]  # R^T x: axes of frame t
        rows.append(
            [
                draw_body(cells[t], video.filmed(body, K_t), faces, cuts[t].camera(K_t))
                for t, body, K_t in zip(
                    frames, bodies, lens_of(K, camera.zoom[list(frames)]), strict=True
                )
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
        [f"frame {keypoints.frames[t]}" for t in frames],
        keypoints.id,
        "orange: the performer's left, blue: right; from the side: depth, which the picture hides",
    )


def moment_cells(
    video: SheetVideo,
    frames: Sequence[int | None],
    cells: dict[int, Image],
    cuts: dict[int, Window],
) -> list[Image]:
    """The final skeleton over the frames that show some moments; blank where there is none."""
    row = []
    for t in frames:
        if t is None:
            row.append(blank_cell())
            continue
        joints = video.final.joints[t] @ video.camera.R_first_from_frame[t]
        K = lens_of(video.K, video.camera.zoom[t])
        row.append(draw_skeleton(cells[t], video.filmed(joints, K), cuts[t].camera(K)))
    return row

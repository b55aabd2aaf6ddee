"""Sheets of pictures: contact sheets of the videos, bodies from three sides, several results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int, Real
from matplotlib.figure import Figure

from imocap_core import rotations
from imocap_core.adapters.ground import ground_of
from imocap_core.adapters.lenses import lenses_of
from imocap_core.adapters.relative_motion import paths_of, paths_of_initial, relative_motions
from imocap_core.artifacts.schemas import (
    Camera,
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
from imocap_core.camera.gravity import GroundAlignment, upright_alignment
from imocap_core.camera.projection import Lens
from imocap_core.camera.zooming import lens_of
from imocap_core.evaluate.scoreboard import posed_body
from imocap_core.figures.overlays import (
    CELL_PX,
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
from imocap_core.figures.style import write
from imocap_core.io.video import read_rgb_of
from imocap_core.render import UP, VIEWS, common_scale, draw_view, heading_of, segment_colors
from imocap_core.workers import thread_map


def surfaces(
    model: Model, motion: VideoMotion, frames: Sequence[int]
) -> Float[np.ndarray, "F V 3"]:
    """Vertices at F frames (indices) of a motion, in its camera's axes."""
    return np.asarray(posed_body(model, motion, list(frames)).mesh().vertices.numpy())


_COLUMNS, _BLANK = 6, 92  # and the grey of a cell without a picture
_GAP_FRAMES = 4.0
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
    R_upright_from_cam: Float[np.ndarray, "3 3"]  # y up, -z ahead
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
    refined: RefineSync | None,
    files: Mapping[str, Path | None],
    model: Model,
) -> list[SheetVideo]:
    """Each video with its monocular and its final motion, relative to the place of its camera.

    refined: None before there is a final motion; the monocular is in its place. files: video id ->
    its file.
    """
    alone = relative_motions(initial.videos, paths_of_initial(initial, camera_motion))
    joint, intrinsics = alone, [camera.K for camera in camera_motion.videos]
    level = [np.diag([1.0, -1.0, -1.0])] * len(alone)
    if refined is not None:
        cameras = refined.motion.cameras
        joint = relative_motions(refined.motion.videos, paths_of(cameras))
        intrinsics = [camera.K for camera in cameras]
        level = [upright_world(refined, c.id).R_upright_from_world @ c.R.T for c in cameras]
    lenses = lenses_of(camera_motion, refined)
    return [
        SheetVideo(
            keypoints=video,
            camera=camera,
            file=files[video.id],
            layout_names=model.points(video.layout).names,
            monocular=first,
            final=last,
            K=K,
            R_upright_from_cam=R,
            lens=lenses.get(video.id),
        )
        for video, camera, first, last, K, R in zip(
            keypoints.videos, camera_motion.videos, alone, joint, intrinsics, level, strict=True
        )
    ]


def spread(count: int, columns: int = _COLUMNS) -> Int[np.ndarray, " _"]:
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
        inside = first <= moment <= last and distance[nearest] <= _GAP_FRAMES
        chosen.append(nearest if inside else None)
    return chosen


def read_cells(
    keypoints: VideoKeypoints, file: Path | None, frames: Sequence[int]
) -> tuple[dict[int, Image], dict[int, Window]]:
    """Crops of the person in some used frames (indices), blank without a video file; and where
    they were cut."""
    boxes = windows(keypoints.person_box_px[list(frames)], keypoints.size)
    cuts = dict(zip(frames, boxes, strict=True))
    cells = {t: blank_cell() for t in frames}
    if file is not None:
        source = {t: int(keypoints.frames[t]) for t in frames}
        for number, picture in read_rgb_of(file, set(source.values())):
            for t in (t for t in frames if source[t] == number):
                cells[t] = cuts[t].cut(picture)
    return cells, cuts


def detected_cells(
    keypoints: VideoKeypoints,
    names: Sequence[str],
    frames: Sequence[int],
    cells: Mapping[int, Image],
    cuts: Mapping[int, Window],
) -> dict[int, Image]:
    """The detections of each frame (index) over its cell; names: of the layout's keypoints."""
    return {
        t: draw_keypoints(
            cells[t], cuts[t].points(keypoints.xy_px[t]), keypoints.confidence[t], names
        )
        for t in frames
    }


def body_cells(
    video: SheetVideo,
    motion: VideoMotion,
    K: Float[np.ndarray, "3 3"],
    model: Model,
    frames: Sequence[int],
    cells: Mapping[int, Image],
    cuts: Mapping[int, Window],
) -> tuple[list[Image], Float[np.ndarray, "F V 3"]]:
    """A motion's body over the cells of some frames (indices), and its surfaces, upright
    before the camera. K: of the first frame."""
    camera, chosen = video.camera, list(frames)
    posed = surfaces(model, motion, frames)
    bodies = posed @ camera.R_first_from_frame[chosen]  # R^T x
    row = [
        draw_body(cells[t], video.filmed(body, K_t), model.faces.numpy(), cuts[t].camera(K_t))
        for t, body, K_t in zip(frames, bodies, lens_of(K, camera.zoom[chosen]), strict=True)
    ]
    return row, posed @ video.R_upright_from_cam.T


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
    detected = list(detected_cells(keypoints, video.layout_names, frames, cells, cuts).values())
    rows = [detected]
    sides = []
    for motion, K in ((video.monocular, camera.K), (video.final, video.K)):
        row, bodies = body_cells(video, motion, K, model, frames, cells, cuts)
        rows.append(row)
        sides.append(from_the_side(bodies, faces))
    names = ["monocular", "after loop"]
    return contact_sheet(
        [*rows, *sides],
        ["detections", *names, *(f"{name},\nfrom the side" for name in names)],
        [f"frame {keypoints.frames[t]}" for t in frames],
    )


def moment_cells(
    video: SheetVideo,
    frames: Sequence[int | None],
    cells: dict[int, Image],
    cuts: dict[int, Window],
) -> list[Image]:
    """The final skeleton over the frames that show some moments, or the word that there is none."""
    row = []
    for t in frames:
        if t is None:
            blank = np.full_like(blank_cell(), _BLANK)
            write(blank, "not in this clip", (CELL_PX[0] // 2, CELL_PX[1] // 2), 0.5, before=0.5)
            row.append(blank)
            continue
        joints = video.final.joints[t] @ video.camera.R_first_from_frame[t]
        K = lens_of(video.K, video.camera.zoom[t])
        row.append(draw_skeleton(cells[t], video.filmed(joints, K), cuts[t].camera(K)))
    return row


@dataclass(frozen=True)
class SheetResult:
    """Motions in the order of the videos, and the intrinsics of each by video id."""

    name: str
    motions: Sequence[VideoMotion]
    K: Mapping[str, Float[np.ndarray, "3 3"]]


def most_different_frames(first: VideoMotion, last: VideoMotion, count: int) -> list[int]:
    """In each of `count` equal parts of a video the frame in which two results differ most."""
    a, b = (m.joints - m.joints[:, :1] for m in (first, last))
    apart = np.linalg.norm(a - b, axis=-1).mean(axis=1)
    parts = np.array_split(np.arange(len(apart)), min(count, len(apart)))
    return [int(part[apart[part].argmax()]) for part in parts]


def picks_of(videos: Sequence[SheetVideo]) -> list[tuple[int, int]]:
    """(video, index of a used frame) per column: where monocular and final motion differ most."""
    each = max(1, _COLUMNS // len(videos))
    return [
        (v, t)
        for v, video in enumerate(videos[:_COLUMNS])
        for t in most_different_frames(video.monocular, video.final, each)
    ]


def results_sheet(
    videos: Sequence[SheetVideo],
    results: Sequence[SheetResult],
    picks: Sequence[tuple[int, int]],
    cells: Mapping[str, Mapping[int, Image]],
    cuts: Mapping[str, Mapping[int, Window]],
    model: Model,
) -> Figure:
    """One column per pick; each result in a row over the frame and a row from the side."""
    faces = model.faces.numpy()

    def rows(result: SheetResult) -> tuple[list[Image], list[Image]]:
        row, bodies = [], []
        for v, t in picks:
            name, motion = videos[v].keypoints.id, result.motions[v]
            over, posed = body_cells(
                videos[v], motion, result.K[name], model, [t], cells[name], cuts[name]
            )
            row += over
            bodies.append(posed[0])
        return row, from_the_side(np.stack(bodies), faces)

    over, side = zip(*thread_map(rows, results), strict=True)
    return contact_sheet(
        [*over, *side],
        [*(r.name for r in results), *(f"{r.name},\nfrom the side" for r in results)],
        [f"{videos[v].keypoints.id} frame {videos[v].keypoints.frames[t]}" for v, t in picks],
    )


_ARMS_DOWN_RAD = 1.1  # of the rest pose beside the phases
CAPTION = (
    "The recovered body of {video} from its front, its right side and its back. The first "
    "column is the same body at rest. The colours are the torso's segments (blue: pelvis, yellow: "
    "spine1, green: spine2, red: spine3, violet: collars): in an upright pose "
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


def upright_world(refined: RefineSync, ahead: str = "") -> GroundAlignment:
    """The world with y up, the ground at 0, and a video's camera looking along -z, the reference's
    by default; without a ground, up is the reference camera's."""
    motion = refined.motion
    if motion.ground is None:
        return GroundAlignment(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
    camera = next(c for c in motion.cameras if c.id == (ahead or motion.reference))
    return upright_alignment(ground_of(motion.ground), camera.R, "y")


def upright_bodies(
    motion: VideoMotion,
    camera: Camera,
    ground: GroundAlignment,
    model: Model,
    frames: Sequence[int],
) -> tuple[Float[np.ndarray, "F V 3"], Float[np.ndarray, "F 3"]]:
    """Surfaces in the upright world at F frames (indices), and where they face."""
    R_upright_from_cam = ground.R_upright_from_world @ camera.R.T
    in_world = (surfaces(model, motion, frames) - camera.t) @ camera.R
    R_root = rotations.exp(torch.from_numpy(motion.theta[list(frames), :3])).numpy()
    headings = np.stack([heading_of(R) for R in R_upright_from_cam @ R_root])
    return in_world @ ground.R_upright_from_world.T + ground.t, headings


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
    posed, facing = upright_bodies(motion, camera, ground, model, frames)
    bodies = np.concatenate([_at_rest(model, motion.betas)[None], posed])
    headings = np.concatenate([heading_of(np.eye(3))[None], facing])

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
    )


def _at_rest(model: Model, betas: Float[np.ndarray, " B"]) -> Float[np.ndarray, "V 3"]:
    """The body's surface with its arms lowered, on the ground of the upright world."""
    theta = torch.zeros(len(model.joint_names), 3, dtype=torch.float64)
    for name, sign in (("left_shoulder", -1.0), ("right_shoulder", 1.0)):
        theta[model.joint_names.index(name), 2] = sign * _ARMS_DOWN_RAD
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

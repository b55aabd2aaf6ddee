"""A second look at a video: which pictures are looked at, and which of what is seen is taken.

After the first joint motion, a limb joint is looked for again where the detector was in doubt and
the other videos contradict it, and everybody's points where nobody was detected. A joint is moved
to a place where the networks see one, near where the others expect it; where the picture shows
nothing there, it stays: performances may differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from imocap_core.adapters.joint import JointProblem
from imocap_core.adapters.lenses import lens_from, undistorted_px
from imocap_core.adapters.observations import columns_of
from imocap_core.artifacts.schemas import (
    CameraMotion,
    Keypoints,
    Redetect,
    RedetectedVideo,
    VideoCameraMotion,
    VideoKeypoints,
)
from imocap_core.body.layouts import layout_names
from imocap_core.camera.projection import warp
from imocap_core.motion.multiview.repair import SURE, contradicted, expected_by_others
from imocap_core.motion.multiview.scene import JointMotion
from imocap_core.pipeline.stage import Inputs

REDETECTED = {
    "elbow": (),
    "wrist": ("pinky", "index", "thumb"),
    "knee": (),
    "ankle": ("heel", "foot_index"),
}  # and the points beyond a joint, which were detected with it
NEARER = 0.5  # distance of a place that is taken, of that of the detection
PRESENT = 0.5  # probability of a person where nobody was detected before
Replacements = dict[tuple[int, int], tuple[float, ...]]  # x, y, confidence by frame and point


@dataclass(frozen=True)
class ContradictedVideo:
    """What the other videos expect of one video, in its used frames that are to be looked at.

    Attributes:
        rows: (N,) these frames, numbered from 0.
        expected_px: (N, K, 2) its points in the frame's picture, and limit_px: (N, K) how far from
            there a detection may be.
        is_contradicted: (N, K) joints that are to be looked for; is_lost: (N,) nobody was detected.
    """

    id: str
    rows: Int[np.ndarray, " N"]
    expected_px: Float[np.ndarray, "N K 2"]
    limit_px: Float[np.ndarray, "N K"]
    is_contradicted: Bool[np.ndarray, "N K"]
    is_lost: Bool[np.ndarray, " N"]


@dataclass(frozen=True)
class SecondLook:
    """What a second look sees in one picture.

    limbs_px: of each kind of limb joint the places (C, 2) where one of both sides may be, pixels.
    body: (K, 3) the whole body, x, y, confidence. presence: probability that there is one.
    """

    limbs_px: dict[str, Float[np.ndarray, "_ 2"]]
    body: Float[np.ndarray, "K 3"]
    presence: float


def contradicted_videos(
    problem: JointProblem, motion: JointMotion, videos: Sequence[str]
) -> list[ContradictedVideo]:
    """Those of some videos (ids) with frames that are to be looked at again.

    A video that is taken for its mirror image is left as it is.
    """
    scene, participants = problem.scene_of(motion), problem.participants
    columns = columns_of(scene.body, participants.keypoints)
    expected = expected_by_others(scene, motion.state, motion.cameras)
    results = []
    for video, camera, o, others in zip(
        participants.keypoints.videos,
        participants.camera_motion.videos,
        scene.observations,
        expected,
        strict=True,
    ):
        if video.id not in videos or video.id in participants.mirrored:
            continue
        used, here = columns[video.layout]
        has_prediction = np.isfinite(others.xy_px[:, here]).all(axis=(1, 2))
        wrong = np.zeros(video.confidence.shape, dtype=bool)
        wrong[:, used] = contradicted(o, others, scene.body.keypoints.names)[:, here]
        lost = has_prediction & ~(video.confidence > 0).any(axis=1)
        rows = np.flatnonzero(lost | (has_prediction & wrong.any(axis=1)))
        if len(rows):
            xy_px = np.full((len(rows), *video.xy_px.shape[1:]), np.nan)
            xy_px[:, used] = _in_pictures(others.xy_px[:, here][rows], rows, camera)
            limit_px = np.zeros(xy_px.shape[:2])
            limit_px[:, used] = others.limit_px[:, here][rows]
            results.append(
                ContradictedVideo(video.id, rows, xy_px, limit_px, wrong[rows], lost[rows])
            )
    return results


def redetected(
    asked: ContradictedVideo,
    looks: Sequence[SecondLook],
    video: VideoKeypoints,
    camera: VideoCameraMotion,
) -> RedetectedVideo:
    """What of a second look is taken, of every frame that was looked at."""
    names = layout_names(video.layout)
    taken: Replacements = {}
    for n, look in enumerate(looks):
        if not asked.is_lost[n]:
            for k in np.flatnonzero(asked.is_contradicted[n]).tolist():
                taken |= _moved_joint(asked, n, k, look, video, names)
        elif look.presence >= PRESENT and _fits(look.body, asked, n, names):
            row = int(asked.rows[n])
            taken |= {(row, k): tuple(values) for k, values in enumerate(look.body.tolist())}
    frame, point = np.array([*taken], int).reshape(-1, 2).T
    values = np.array([*taken.values()], float).reshape(-1, 3)
    return RedetectedVideo(
        id=video.id,
        looked_at=asked.rows,
        contradicted=int(asked.is_contradicted.sum()),
        frame=frame,
        point=point,
        xy_px=values[:, :2],
        xy_first_px=warp(
            camera.H_first_from_frame[frame], undistorted_px(values[:, :2], camera.lens, camera.K)
        ),
        confidence=values[:, 2],
    )


def is_changed(again: Redetect) -> bool:
    """Whether a second look changes any keypoint."""
    return any(len(video.frame) > 0 for video in again.videos)


def with_redetected(
    keypoints: Keypoints, cameras: CameraMotion, again: Redetect
) -> tuple[Keypoints, CameraMotion]:
    """Keypoints, as detected and as warped, with what a second look saw in its place."""
    if not is_changed(again):
        return keypoints, cameras
    by_id = {video.id: video for video in again.videos}
    videos, moving = [], []
    for video, camera in zip(keypoints.videos, cameras.videos, strict=True):
        if video.id in by_id:
            new = by_id[video.id]
            places = (new.frame, new.point)
            update: dict[str, object] = {
                "xy_px": _replaced(video.xy_px, places, new.xy_px),
                "confidence": _replaced(video.confidence, places, new.confidence),
            }
            if video.corrected is not None:
                marks = _replaced(video.corrected.xy_px, places, new.xy_px)
                update["corrected"] = video.corrected.model_copy(update={"xy_px": marks})
            video = video.model_copy(update=update)
            warped = _replaced(camera.xy_first_px, places, new.xy_first_px)
            camera = camera.model_copy(update={"xy_first_px": warped})
        videos.append(video)
        moving.append(camera)
    return keypoints.model_copy(update={"videos": videos}), CameraMotion(videos=moving)


def with_second_look(inputs: Inputs) -> Inputs:
    """A stage's inputs, with what `redetect` saw in the place of what was detected first."""
    keypoints, cameras = with_redetected(
        inputs.get(Keypoints), inputs.get(CameraMotion), inputs.get(Redetect)
    )
    return inputs.with_artifacts(keypoints, cameras)


def _moved_joint(
    asked: ContradictedVideo,
    n: int,
    k: int,
    look: SecondLook,
    video: VideoKeypoints,
    names: Sequence[str],
) -> Replacements:
    """A contradicted joint at the place that is taken, and the points beyond it, which count for
    nothing then; empty where the picture shows none near enough."""
    row, (side, _, kind) = int(asked.rows[n]), names[k].partition("_")
    away = np.linalg.norm(video.xy_px[row, k] - asked.expected_px[n, k])
    limit = min(float(asked.limit_px[n, k]), NEARER * float(away))
    place = _nearest(look.limbs_px[kind], asked.expected_px[n, k], limit)
    if place is None:
        return {}
    beyond = [names.index(p) for p in (f"{side}_{tip}" for tip in REDETECTED[kind]) if p in names]
    ends = {(row, end): (*video.xy_px[row, end].tolist(), 0.0) for end in beyond}
    return {(row, k): (*place, SURE), **ends}


def _fits(
    body: Float[np.ndarray, "K 3"], asked: ContradictedVideo, n: int, names: Sequence[str]
) -> bool:
    """Whether most limb joints of a body are where the others expect them."""
    limbs = [k for k, name in enumerate(names) if name.partition("_")[2] in REDETECTED]
    away = np.linalg.norm(body[limbs, :2] - asked.expected_px[n, limbs], axis=1)
    return bool(np.median(away / asked.limit_px[n, limbs]) < 1.0)


def _nearest(
    places: Float[np.ndarray, "C 2"], expected: Float[np.ndarray, "2"], limit_px: float
) -> list[float] | None:
    """The place nearest to the expected one, None where none is within the limit."""
    away = np.linalg.norm(places - expected, axis=1)
    if not (away < limit_px).any():
        return None
    nearest: list[float] = places[int(away.argmin())].tolist()
    return nearest


def _in_pictures(
    xy_first_px: Float[np.ndarray, "N K 2"], rows: Int[np.ndarray, " N"], camera: VideoCameraMotion
) -> Float[np.ndarray, "N K 2"]:
    """Pixels of the first frame's picture in those of other frames, with the lens."""
    xy_px = warp(np.linalg.inv(camera.H_first_from_frame[rows])[:, None], xy_first_px)
    lens = lens_from(camera.lens, camera.K)
    return xy_px if lens is None else lens.distorted(xy_px)


def _replaced(
    values: Float[np.ndarray, "T K *rest"],
    places: tuple[Int[np.ndarray, " C"], Int[np.ndarray, " C"]],
    new: Float[np.ndarray, "C *rest"],
) -> Float[np.ndarray, "T K *rest"]:
    changed = values.copy()
    changed[places] = new
    return changed

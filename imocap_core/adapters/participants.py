"""The videos that the joint motion is solved on: those of the action, none of them mirrored.

Videos that sync excluded are left out, and mirrored ones are reflected (`motion.mirror`), so that
everything downstream sees one action. Results go back as they were filmed: a mirrored video's
motion is reflected again and its camera is that of the mirror image of the world; an excluded video
keeps its monocular motion, in its own camera's axes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from imocap_core.adapters.relative_motion import paths_of_initial
from imocap_core.artifacts.schemas import (
    Camera,
    CameraMotion,
    InitialSmpl,
    Keypoints,
    SmplBa,
    SyncSummary,
    VideoCameraMotion,
    VideoKeypoints,
    VideoMotion,
)
from imocap_core.body import Model
from imocap_core.body.layouts import layout_names
from imocap_core.conventions import mirror_indices
from imocap_core.motion import state


@dataclass(frozen=True)
class Participants:
    """The inputs of the joint motion, and the way back; made by `participants_of`."""

    keypoints: Keypoints
    camera_motion: CameraMotion
    initial: InitialSmpl
    all_initial: InitialSmpl
    all_cameras: CameraMotion
    mirrored: frozenset[str]
    excluded: frozenset[str]
    body: Model

    def sync(self, sync: SyncSummary) -> SyncSummary:
        """Correspondences of the participants alone."""
        index = [k for k, i in enumerate(sync.ids) if i not in self.excluded]
        return SyncSummary(
            reference=sync.reference,
            ids=[sync.ids[k] for k in index],
            lengths=[sync.lengths[k] for k in index],
            maps=[sync.maps[k] for k in index],
            method=sync.method,
            centrality=sync.centrality[index],
            status=sync.status,
            trust=sync.trust
            and sync.trust.model_copy(update={"videos": [sync.trust.videos[k] for k in index]}),
        )

    def motions(self, videos: Sequence[VideoMotion]) -> list[VideoMotion]:
        """The participants' motions, from as filmed to as solved."""
        return [self._reflected(v) for v in videos if v.id not in self.excluded]

    def cameras(self, cameras: Sequence[Camera]) -> list[Camera]:
        """The participants' cameras, from as filmed to as solved."""
        return [
            mirrored_camera(c) if c.id in self.mirrored else c
            for c in cameras
            if c.id not in self.excluded
        ]

    def as_filmed(self, result: SmplBa) -> SmplBa:
        """A solved result of the participants, as filmed and of all videos."""
        if not self.mirrored and not self.excluded:
            return result
        motions = {v.id: self._reflected(v) for v in result.videos}
        cameras = {c.id: mirrored_camera(c) if c.id in self.mirrored else c for c in result.cameras}
        paths = paths_of_initial(self.all_initial, self.all_cameras)
        for motion, camera in zip(self.all_initial.videos, self.all_cameras.videos, strict=True):
            if motion.id in self.excluded:
                motions[motion.id] = motion
                cameras[motion.id] = Camera(
                    id=motion.id, K=camera.K, R=np.eye(3), t=np.zeros(3),
                    path_m=paths.get(motion.id, np.zeros((0, 3))),
                )  # fmt: skip
        ids = [v.id for v in self.all_initial.videos]
        return result.model_copy(
            update={"videos": [motions[i] for i in ids], "cameras": [cameras[i] for i in ids]}
        )

    def filmed_joints(
        self, joints: Sequence[Float[np.ndarray, "_ 24 3"]]
    ) -> list[Float[np.ndarray, "_ 24 3"]]:
        """Joints of all videos as filmed, from the participants' as solved."""
        by_id = {}
        for video, of_video in zip(self.keypoints.videos, joints, strict=True):
            mirrored = video.id in self.mirrored
            by_id[video.id] = state.mirrored_joints(of_video) if mirrored else of_video
        return [by_id.get(v.id, v.joints) for v in self.all_initial.videos]

    def filmed_covariance(
        self, video: str, covariance: Float[np.ndarray, "_ 24 3 3"]
    ) -> Float[np.ndarray, "_ 24 3 3"]:
        """Covariances of a participant's joints, from as solved to as filmed."""
        return state.mirrored_covariance(covariance) if video in self.mirrored else covariance

    def _reflected(self, motion: VideoMotion) -> VideoMotion:
        return mirrored_motion(motion, self.body) if motion.id in self.mirrored else motion


def participants_of(
    keypoints: Keypoints,
    camera_motion: CameraMotion,
    initial: InitialSmpl,
    sync: SyncSummary,
    body: Model,
) -> Participants:
    """The participants according to a synchronisation; `body` with SMPL's joints."""
    flips, out = frozenset(sync.mirrored), frozenset(sync.excluded)
    detections, cameras, motions = [], [], []
    rows = zip(keypoints.videos, camera_motion.videos, initial.videos, strict=True)
    for video, camera, motion in rows:
        if video.id in out:
            continue
        flip = video.id in flips
        detections.append(mirrored_keypoints(video, camera.K) if flip else video)
        cameras.append(mirrored_detections(camera, video.layout) if flip else camera)
        motions.append(mirrored_motion(motion, body) if flip else motion)
    return Participants(
        keypoints=Keypoints(videos=detections),
        camera_motion=CameraMotion(videos=cameras),
        initial=initial.model_copy(update={"videos": motions}),
        all_initial=initial,
        all_cameras=camera_motion,
        mirrored=flips - out,
        excluded=out,
        body=body,
    )


def known_mirrors(declared: Mapping[str, bool | None], keypoints: Keypoints) -> list[bool | None]:
    """Of each video, whether it is mirrored: as declared, else as its file says; None where sync
    decides."""
    given = ((declared[video.id], video.mirrored) for video in keypoints.videos)
    return [of_file if by_user is None else by_user for by_user, of_file in given]


def mirrored_motion(motion: VideoMotion, body: Model) -> VideoMotion:
    """The motion seen in a mirror, in the axes of its own camera."""
    betas = torch.as_tensor(motion.betas).to(body.v_template)
    rest = body.shape(betas).joints_rest[..., 0, :].cpu().numpy().reshape(3)
    return motion.model_copy(
        update={
            "theta": state.mirrored_pose(motion.theta),
            "trans": state.mirrored_translation(motion.trans, rest),
            "joints": state.mirrored_joints(motion.joints),
        }
    )


def mirrored_camera(camera: Camera) -> Camera:
    """The camera that films the mirror image of the world and shows the mirror image."""
    R, t = state.mirrored_extrinsics(camera.R, camera.t)
    path = camera.path_m * (-1.0, 1.0, 1.0)
    return camera.model_copy(update={"R": R, "t": t, "path_m": path})


def mirrored_keypoints(video: VideoKeypoints, K: Float[np.ndarray, "3 3"]) -> VideoKeypoints:
    """Detections of the reflected picture, left and right swapped."""
    twins = mirror_indices(layout_names(video.layout))
    return video.model_copy(
        update={
            "xy_px": state.mirrored_pixels(video.xy_px, K, twins),
            "confidence": video.confidence[:, list(twins)],
            "corrected": None,
            "person_box_px": state.mirrored_boxes(video.person_box_px, K),
        }
    )


def mirrored_detections(camera: VideoCameraMotion, layout: str) -> VideoCameraMotion:
    """A camera's warped detections and path, reflected; the homographies stay those of the
    pictures."""
    twins = mirror_indices(layout_names(layout))
    return camera.model_copy(
        update={
            "xy_first_px": state.mirrored_pixels(camera.xy_first_px, camera.K, twins),
            "path": camera.path * (-1.0, 1.0, 1.0),
        }
    )

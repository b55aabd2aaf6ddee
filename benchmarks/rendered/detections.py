"""Detections of rendered videos beside their true points, and errors of the detector's own 3D."""

from __future__ import annotations

import numpy as np

from benchmarks.detector.detection_errors import DetectedClip
from benchmarks.rendered.action import LAYOUT, POINTS
from imocap_core.evaluate.scoreboard import true_joints
from imocap_core.io.readers.estimates import PerformerBoxes
from imocap_core.io.readers.mediapipe import read_mediapipe, read_mediapipe_world
from imocap_core.io.truth import read_truth
from imocap_core.io.video import probe
from imocap_core.metrics.scoring import CameraJoints, over_videos, pose_rows
from imocap_core.pipeline.runner import Job


def detected_clips(job: Job) -> tuple[list[DetectedClip], tuple[str, ...]]:
    """Detections of the action's videos, and the names of their points; all must be detected."""
    clips = []
    names: tuple[str, ...] = ()
    least = job.settings.params.keypoints.min_confidence
    with np.load(job.action.folder / POINTS) as stored:
        for video in job.action.videos:
            assert video.video is not None
            info = probe(job.action.folder / video.video)
            detections = read_mediapipe(job.action.detected[video.id], LAYOUT, info.size)
            true, columns = stored[f"{video.id}/xy_px"], stored[f"{video.id}/columns"]
            names = tuple(str(name) for name in stored[f"{video.id}/names"])
            xy_px, used = np.full(true.shape, np.nan), np.zeros(true.shape[:2], dtype=bool)
            for frame, people in zip(detections.frames.tolist(), detections.people, strict=True):
                if len(people) and frame < len(true):
                    xy_px[frame] = people[0][columns, :2]
                    used[frame] = people[0][columns, 2] >= least
            height, side = stored[f"{video.id}/height_px"], str(stored[f"{video.id}/side"])
            clips.append(DetectedClip(xy_px, true, height, side, info.fps, used))
    return clips, names


def detector_3d_errors(job: Job) -> dict[str, float]:
    """Errors of the detector's own 3D landmarks: metric -> mean over the videos."""
    assert job.action.truth is not None
    rows = []
    infos = {v.id: probe(job.action.folder / str(v.video)) for v in job.action.videos}
    used = {name: np.arange(info.frame_count) for name, info in infos.items()}
    truth = read_truth(job.action.folder / job.action.truth, used)
    for name, info in infos.items():
        true = true_joints(truth.videos[name], used[name])
        if true is None:
            continue
        everywhere = np.tile([0.0, 0.0, *info.size], (len(used[name]), 1))
        boxes = PerformerBoxes(used[name], everywhere, info.size)
        landmarks = read_mediapipe_world(job.action.detected[name], boxes)
        motion = CameraJoints(landmarks.joints, landmarks.joint_names, used[name])
        rows += pose_rows("estimator", name, motion, true, info.fps)
    return {row.metric: row.value for row in over_videos(rows) if row.value is not None}

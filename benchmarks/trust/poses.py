"""Poses that `imocap benchmark trust` screens: the pipeline's monocular fits, and the true ones."""

from __future__ import annotations

import numpy as np

from benchmarks.actions.captured import data_folder, trial_videos
from benchmarks.actions.choice import Choice
from benchmarks.actions.prepare import action_names, ready_job
from benchmarks.parallel import ActionDisplay
from benchmarks.trust.screened import PoseVideos
from imocap_core.artifacts.schemas import InitialSmpl, Keypoints
from imocap_core.conventions import EVAL_14, SMPL_JOINTS, mirror_indices
from imocap_core.pipeline import runner
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace

LAST = "initial_smpl"
TRIALS = Choice("trials")


def fitted(workspace: Workspace, display: Display) -> dict[str, PoseVideos]:
    """The monocular fits of every action of trials; missing ones are made."""
    actions = {}
    for name in action_names(workspace.root, TRIALS):
        action_display = ActionDisplay(display, name)
        job = ready_job(workspace, TRIALS, name, (), action_display)
        outcomes = runner.run(job, action_display, job.pipeline.upstream(LAST))
        done = {outcome.stage: outcome.stored for outcome in outcomes}
        fits, keypoints = done[LAST].decode(InitialSmpl), done["keypoints"].decode(Keypoints)
        actions[name] = PoseVideos(
            [np.asarray(video.joints) for video in fits.videos],
            [video.fps for video in keypoints.videos],
            tuple(mirror_indices(SMPL_JOINTS)),
        )
    return actions


def true_poses(workspace: Workspace) -> dict[str, PoseVideos]:
    """The captured joints of every action of trials."""
    folder = data_folder(workspace.root, TRIALS.name)
    actions = {}
    for name in action_names(workspace.root, TRIALS):
        videos = trial_videos(folder / f"{name}.npz", TRIALS.videos)
        actions[name] = PoseVideos(
            [video.joints_m for video in videos],
            [video.fps for video in videos],
            tuple(mirror_indices(EVAL_14)),
        )
    return actions

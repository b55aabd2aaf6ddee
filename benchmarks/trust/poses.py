"""What `imocap benchmark trust` screens: the pipeline's own monocular fits, and the true poses."""

from __future__ import annotations

import numpy as np

from benchmarks.actions.captured import data_folder, trial_shots
from benchmarks.actions.choice import Choice
from benchmarks.actions.prepare import action_names, ready_job
from benchmarks.parallel import Named
from benchmarks.trust.screened import Seen
from imocap_core.artifacts.schemas import InitialSmpl, Keypoints
from imocap_core.conventions import EVAL_14, SMPL_JOINTS, mirror_indices
from imocap_core.pipeline import runner
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace

LAST = "initial_smpl"
TRIALS = Choice("trials")


def fitted(workspace: Workspace, display: Display) -> dict[str, Seen]:
    """The monocular fits of every action of trials; what is missing is made."""
    found = {}
    for name in action_names(workspace.root, TRIALS):
        named = Named(display, name)
        job = ready_job(workspace, TRIALS, name, (), named)
        done = {o.stage: o.stored for o in runner.run(job, named, job.pipeline.upstream(LAST))}
        fits, keypoints = done[LAST].decode(InitialSmpl), done["keypoints"].decode(Keypoints)
        found[name] = Seen(
            [np.asarray(video.joints) for video in fits.videos],
            [video.fps for video in keypoints.videos],
            tuple(mirror_indices(SMPL_JOINTS)),
        )
    return found


def true_poses(workspace: Workspace) -> dict[str, Seen]:
    """The captured joints themselves."""
    folder = data_folder(workspace.root, TRIALS.name)
    found = {}
    for name in action_names(workspace.root, TRIALS):
        shots = trial_shots(folder / f"{name}.npz", TRIALS.videos)
        found[name] = Seen(
            [shot.joints_m for shot in shots],
            [shot.fps for shot in shots],
            tuple(mirror_indices(EVAL_14)),
        )
    return found

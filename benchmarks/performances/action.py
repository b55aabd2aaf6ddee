"""Sets of captured takes of one action as actions: each filmed once, by a camera of its own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.actions.action_folder import action_key, make_action
from benchmarks.actions.captured import CapturedVideo, captured_video
from benchmarks.synthetic.trials import align_trials
from imocap_core.pipeline.runner import Display, Job
from imocap_core.pipeline.source import closure
from imocap_core.workspace import Workspace


def takes(file: Path, first: int, count: int) -> list[CapturedVideo]:
    """Some takes, in one scene; a take has the same camera and random numbers in every set."""
    with np.load(file) as stored:
        index, fps = stored["common14_idx"], float(stored["fps"])
        trials = range(first, first + count)
        joints = [stored[f"trial_{v:02d}"][:, index].astype(np.float64) for v in trials]
    videos = [captured_video(trial, fps) for trial in align_trials(joints)]
    return [replace(video, place=first + v) for v, video in enumerate(videos)]


def ready_takes(
    root: Path, file: Path, first: int, count: int, detector: str, display: Display
) -> Job:
    """A job of the action, whose folder is made first unless the same code and data made it."""
    name = f"{count}_from_{first}"
    key = action_key([closure(Path(__file__)), name, detector], [file])
    folder = root / "actions" / name
    make_action(folder, name, lambda: takes(file, first, count), detector, {}, key)
    return Workspace(root).ready_job(str(folder), [], display)

"""An action by two performers: real performances, bodies of their own, simulated detections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.actions.action_folder import action_key, make_action
from benchmarks.actions.captured import CapturedVideo, video_rng, videos_of_performances
from benchmarks.performers.bodies import bone_lengths_m, with_bones
from imocap_core.body import load_free_body
from imocap_core.pipeline.runner import Display, Job
from imocap_core.pipeline.source import closure
from imocap_core.workspace import Workspace

PERFORMERS = ("A", "B")
SHAPE_SD = 0.5  # of the performers' coefficients; a thigh's length then differs by about a tenth
PURPOSE = 29  # of the random numbers: the performers' shapes


def bone_ratios(action: str) -> dict[str, dict[str, float]]:
    """Of each performer, the lengths of bones over those of the mean shape."""
    model = load_free_body()
    mean = bone_lengths_m(model, np.zeros(10))
    ratios = {}
    for number, name in enumerate(PERFORMERS):
        betas = SHAPE_SD * video_rng(action, number, PURPOSE).standard_normal(10)
        lengths = bone_lengths_m(model, betas)
        ratios[name] = {bone: lengths[bone] / mean[bone] for bone in mean}
    return ratios


def performances(files: Sequence[Path], videos: int) -> list[CapturedVideo]:
    """As many performances of each file, of the first performer's first."""
    ratios = bone_ratios(files[0].stem)
    captured = videos_of_performances(files, videos)
    return [
        replace(
            video,
            joints_m=with_bones(video.joints_m, ratios[PERFORMERS[v // videos]]),
            skeleton_m=None,
        )
        for v, video in enumerate(captured)
    ]


def ready_performers(
    root: Path, files: Sequence[Path], videos: int, detector: str, display: Display
) -> Job:
    """A job of the action, whose folder is made first unless the same code and data made it."""
    name = files[0].stem
    key = action_key([closure(Path(__file__)), name, detector, videos], list(files))
    folder = root / "actions" / name
    make_action(folder, name, lambda: performances(files, videos), detector, {}, key)
    return Workspace(root).ready_job(str(folder), [], display)

"""A video that was left out may have another detector's layout than those that remain."""

from __future__ import annotations

import torch

from imocap_core.adapters.joint import problem_of
from imocap_core.artifacts.schemas import Keypoints
from imocap_core.params import Params
from tests.report.made import Made


def test_the_body_has_the_keypoints_of_the_remaining_videos() -> None:
    made, params = Made(3), Params()
    *rest, last = made.keypoints.videos
    other = last.model_copy(
        update={
            "layout": "coco17",
            "xy_px": last.xy_px[:, :17],
            "confidence": last.confidence[:, :17],
        }
    )
    sync = made.sync.model_copy(update={"excluded": ["v3"]})
    problem = problem_of(
        Keypoints(videos=[*rest, other]),
        made.camera_motion,
        made.initial,
        sync,
        params.fit,
        params.motion,
    )
    body, state = problem.scene.body, problem.solution(made.single).state
    projected = body.positions(body.keypoints, state).xyz
    assert {o.xy_px.shape[1] for o in problem.scene.observations} == {projected.shape[2]}
    assert torch.isfinite(projected[:, 0]).all()

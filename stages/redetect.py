"""redetect: a second look where the other videos contradict what was detected (section 3.3)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from imocap_core.adapters import redetection
from imocap_core.adapters.joint import problem_of
from imocap_core.artifacts.schemas import (
    CameraMotion,
    InitialSmpl,
    Keypoints,
    Redetect,
    SmplBa,
    Sync,
    VideoKeypoints,
)
from imocap_core.cli import stage_main
from imocap_core.detect.detection import set_up
from imocap_core.detect.detection_again import LAYOUT, KnownPlaces, look_again
from imocap_core.detect.detectors import detector_of
from imocap_core.errors import WorkFailed
from imocap_core.params import Params
from imocap_core.pipeline.stage import Context, Inputs

NOBODY = "no video was detected by BlazePose, or redetect.enabled is off"
NOTHING = "no detection contradicts the other videos"


def run(ctx: Context, inputs: Inputs, params: Params) -> Redetect:
    """Look once more for contradicted limbs, in the videos that BlazePose detected."""
    videos = {video.id: video for video in inputs.get(Keypoints).videos}
    detected = [v.id for v in ctx.declarations() if v.detected and v.id in videos]
    detected = [i for i in detected if videos[i].layout == LAYOUT and params.redetect.enabled]
    if not detected:
        return Redetect(videos=[], note=NOBODY)
    asked = _contradicted(ctx, inputs, params, detected)
    if not asked:
        return Redetect(videos=[], note=NOTHING)
    cameras = {camera.id: camera for camera in inputs.get(CameraMotion).videos}
    looks = _looks(ctx, asked, [videos[one.id] for one in asked], params)
    return Redetect(
        videos=[
            redetection.redetected(one, of_video, videos[one.id], cameras[one.id])
            for one, of_video in zip(asked, looks, strict=True)
        ],
        note="",
    )


def _contradicted(
    ctx: Context, inputs: Inputs, params: Params, videos: Sequence[str]
) -> list[redetection.ContradictedVideo]:
    """What the first joint motion of the other videos contradicts."""
    problem = problem_of(
        inputs.get(Keypoints),
        inputs.get(CameraMotion),
        inputs.get(InitialSmpl),
        inputs.get(Sync),
        params.fit,
        params.motion,
        event=bool(ctx.event()),
        device=ctx.device,
    )
    return redetection.contradicted_videos(problem, problem.solution(inputs.get(SmplBa)), videos)


def _looks(
    ctx: Context,
    asked: Sequence[redetection.ContradictedVideo],
    videos: Sequence[VideoKeypoints],
    params: Params,
) -> list[list[redetection.SecondLook]]:
    """What is seen in every frame of each video; moments of one picture share a look."""
    places, rows = [], []
    for one, video in zip(asked, videos, strict=True):
        frames, first, of_frame = np.unique(
            video.frames[one.rows], return_index=True, return_inverse=True
        )
        file = ctx.video(one.id)
        assert file is not None
        places.append(KnownPlaces(file, frames, one.expected_px[first]))
        rows.append(of_frame)
    detector = detector_of(params.detect, ctx.action_file().parent)
    try:
        python = set_up(detector, lambda what: ctx.progress(0.1, what))
    except WorkFailed as error:
        raise WorkFailed(
            f"{error}; --set redetect.enabled=false does without a second look"
        ) from None
    looks = look_again(places, detector, python, lambda share: ctx.progress(share, "looking again"))
    return [[of_video[k] for k in of_frame] for of_video, of_frame in zip(looks, rows, strict=True)]


if __name__ == "__main__":
    raise SystemExit(stage_main("redetect"))

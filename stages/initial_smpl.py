"""initial_smpl: the SMPL motion of each video by itself (section 3.2, "Initialization").

Where a monocular estimator's result is given it is the start (and, as 3D joints, evidence);
otherwise the lifter's joints are, or the 2D keypoints are matched against a library of poses seen
from all sides. Either way the start is refined by minimising the reprojection error. A video is
fitted once for all actions that have it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import torch

from imocap_core.adapters.estimates import estimate_of
from imocap_core.adapters.monocular import (
    PoseLibraries,
    SingleVideo,
    fit_single_video,
    joined,
    pose_libraries,
)
from imocap_core.artifacts.schemas import Artifact, CameraMotion, InitialSmpl, Keypoints
from imocap_core.cli import stage_main
from imocap_core.motion.gauss_newton import motions_at_once
from imocap_core.motion.prior import load_pose_prior
from imocap_core.params import Params
from imocap_core.pipeline.stage import Context, Inputs
from imocap_core.workers import thread_map


def run(ctx: Context, inputs: Inputs, params: Params) -> InitialSmpl:
    """A motion for every video by itself."""
    ids = [video.id for video in inputs.get(Keypoints).videos]
    videos = {i: single_video(ctx, inputs, i) for i in ids}
    libraries = pose_libraries(load_pose_prior(ctx.device), ctx.rng, params.initial_smpl)
    ended: list[str] = []

    def part(i: str) -> InitialSmpl:
        def progress(doing: str) -> None:
            ctx.progress(len(ended) / len(ids), f"{i}: {doing}")

        fit = part_of_video(ctx, params, i, videos[i], libraries, len(ids) == 1, progress)
        ended.append(i)
        return fit

    longest = max(video.frames for video in videos.values())
    most = motions_at_once(2 * longest)  # a video's starts are fitted at once, too
    return joined(thread_map(part, ids, most), ids)


def make_part(ctx: Context, inputs: Inputs, params: Params, video: str) -> None:
    """The motion of one video, for a worker of its own; none where the video was left out."""
    ids = [v.id for v in inputs.get(Keypoints).videos]
    if video in ids:
        single = single_video(ctx, inputs, video)
        libraries = pose_libraries(load_pose_prior(ctx.device), ctx.rng, params.initial_smpl)
        alone = len(ids) == 1
        part_of_video(ctx, params, video, single, libraries, alone, partial(ctx.progress, 0.0))


def single_video(ctx: Context, inputs: Inputs, name: str) -> SingleVideo:
    """One video's detections, camera, and monocular estimate, if any."""
    pairs = zip(inputs.get(Keypoints).videos, inputs.get(CameraMotion).videos, strict=True)
    video, camera = next(pair for pair in pairs if pair[0].id == name)
    estimate = estimate_of(ctx, video, torch.as_tensor(camera.R_first_from_frame))
    return SingleVideo.of(video, camera, estimate)


def part_of_video(
    ctx: Context,
    params: Params,
    name: str,
    single: SingleVideo,
    libraries: PoseLibraries,
    alone: bool,
    progress: Callable[[str], None],
) -> InitialSmpl:
    """The fit of one video, kept or made now."""
    made_from: dict[str, Artifact | str] = {
        "keypoints": single.keypoints,
        "camera_motion": single.cameras,
        "initial": ctx.initial_digest(name),
        "alone": str(alone),
    }

    def make() -> InitialSmpl:
        prior, options = load_pose_prior(ctx.device), params.initial_smpl
        return fit_single_video(
            single, prior, libraries, params.fit, options, alone=alone, progress=progress
        )

    return ctx.part("video", made_from, InitialSmpl, make)


if __name__ == "__main__":
    raise SystemExit(stage_main("initial_smpl"))

"""initial_smpl: the SMPL motion of each video by itself (section 3.2, "Initialization").

Where a monocular estimator's result is given it is the start (and, as 3D joints, evidence);
otherwise the lifter's joints are, or the 2D keypoints are matched against a library of poses seen
from all sides. Either way the start is refined by minimising the reprojection error. A video is
fitted once for all actions that have it.
"""

from __future__ import annotations

import torch

from imocap_core.artifacts.schemas import Artifact, CameraMotion, InitialSmpl, Keypoints
from imocap_core.cli import stage_main
from imocap_core.motion.prior import load_pose_prior
from imocap_core.params import Params
from imocap_core.pipeline.stage import Context, Inputs
from imocap_core.problem.estimates import estimate_of
from imocap_core.problem.single_video import SingleVideo, fit_single_video, joined
from imocap_core.problem.swapped_sides import refits_of_swapped
from imocap_core.workers import at_once

AT_ONCE = 2  # videos: more take more memory and are not faster


def run(ctx: Context, inputs: Inputs, params: Params) -> InitialSmpl:
    """A motion for every video by itself."""
    keypoints, cameras = inputs.get(Keypoints), inputs.get(CameraMotion)
    prior, options = load_pose_prior(), params.initial_smpl
    ids = [video.id for video in keypoints.videos]
    alone = len(ids) == 1
    singles = [
        SingleVideo.of(v, camera, estimate_of(ctx, v, torch.as_tensor(camera.R_first_from_frame)))
        for v, camera in zip(keypoints.videos, cameras.videos, strict=True)
    ]
    ended: list[int] = []

    def fit(v: int) -> InitialSmpl:
        def progress(doing: str) -> None:
            ctx.progress(0.8 * len(ended) / len(ids), f"{ids[v]}: {doing}")

        return fit_single_video(
            singles[v], prior, ctx.rng(), params.fit, options, alone=alone, progress=progress
        )

    def kept_or_fitted(v: int) -> InitialSmpl:
        made_from: dict[str, Artifact | str] = {
            "keypoints": singles[v].keypoints,
            "camera_motion": singles[v].cameras,
            "initial": ctx.initial_digest(ids[v]),
            "alternatives": "no" if alone else "yes",
        }
        part = ctx.part("video", made_from, InitialSmpl, lambda: fit(v))
        ended.append(v)
        return part

    result = joined(at_once(kept_or_fitted, range(len(ids)), AT_ONCE), ids)
    if not alone and options.hypotheses > 1:
        ctx.progress(0.8, "sides that the other videos' motions swap")
        refits = refits_of_swapped(singles, result, prior, ctx.rng, params.fit, options)
        result.alternatives.extend(refits)
    return result


if __name__ == "__main__":
    raise SystemExit(stage_main("initial_smpl"))

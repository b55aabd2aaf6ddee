"""initial_smpl: what each video alone says about the motion (section 3.2, "Initialization").

Where a monocular estimator's result is given it is the start (and, as 3D joints, evidence);
otherwise the 2D keypoints are matched against a library of poses seen from all sides. Either way
the start is refined by minimising the reprojection error.
"""

from __future__ import annotations

import numpy as np
import torch

from imocap_core.artifacts.schemas import (
    CameraMotion,
    Hypothesis,
    InitialSmpl,
    Keypoints,
    VideoKeypoints,
)
from imocap_core.cli import stage_main
from imocap_core.lifter.infer import Lifted
from imocap_core.motion.kinematics import Body
from imocap_core.motion.monocular.fit import fit_monocular
from imocap_core.motion.monocular.library import Library, make_library
from imocap_core.motion.monocular.starts import (
    Start,
    fit_rotations_to_joints,
    lifted_starts,
    start_at_joints,
)
from imocap_core.motion.observations import Observation
from imocap_core.motion.prior import load_pose_prior
from imocap_core.params import InitialSmplParams, Params
from imocap_core.pipeline.stage import Context, Inputs
from imocap_core.problem.estimates import Estimate, estimate_of
from imocap_core.problem.lifted import evidence_of, lifted_joints, starts_of
from imocap_core.problem.motion import body_for, motions_of, observations_of
from imocap_core.workers import at_once


def run(ctx: Context, inputs: Inputs, params: Params) -> InitialSmpl:
    """A motion for every video by itself."""
    keypoints, cameras = inputs.get(Keypoints), inputs.get(CameraMotion)
    body, prior = body_for(keypoints), load_pose_prior()
    given = {
        v.id: estimate_of(ctx, v, torch.as_tensor(camera.R_first_from_frame))
        for v, camera in zip(keypoints.videos, cameras.videos, strict=True)
    }
    lifting = params.initial_smpl
    lifted = _lifted(keypoints, cameras, given) if lifting.lifter == "auto" else {}
    joints = {k: g for k, g in given.items() if isinstance(g, np.ndarray)}
    joints |= {k: evidence_of(found) for k, found in lifted.items()}
    observations = observations_of(body, keypoints, cameras, params.fit, joints)
    ctx.progress(0.05, "looking for starts")
    library = make_library(
        body, prior, ctx.rng(), poses=lifting.library_poses, directions=lifting.library_directions
    )
    ids = [video.id for video in keypoints.videos]

    def begun(v: int) -> list[Start]:
        if ids[v] in lifted:
            return starts_of(body, library, observations[v], lifted[ids[v]])
        return _starts(body, library, observations[v], given[ids[v]], lifting)

    starts = at_once(begun, range(len(ids)))
    ctx.progress(0.4, "starts of all videos")
    slowest = min(o.fps for o in observations)
    fit = fit_monocular(
        body, prior, observations, starts, params.fit,
        stride=max(1, round(lifting.stride_s * slowest)), max_steps=lifting.max_steps,
        progress=lambda said: ctx.progress(0.5, said),
    )  # fmt: skip
    return InitialSmpl(
        model=body.model.name,
        model_digest=body.model.digest,
        videos=motions_of(body, fit.state, observations, keypoints),
        source={v.id: _source(v, given, lifted) for v in keypoints.videos},
        hypotheses=[
            Hypothesis(
                video=video.id, name=f"start {n + 1}", cost=cost, chosen=cost == min(costs),
                note="objective of the fit from this start",
            )
            for video, costs in zip(keypoints.videos, fit.costs, strict=True)
            for n, cost in enumerate(costs)
        ],
    )  # fmt: skip


def _lifted(
    keypoints: Keypoints, cameras: CameraMotion, given: dict[str, Estimate]
) -> dict[str, Lifted]:
    """What the lifter says of the videos that have no estimate, where it can say anything."""
    pairs = zip(keypoints.videos, cameras.videos, strict=True)
    told = {v.id: lifted_joints(v, camera) for v, camera in pairs if given[v.id] is None}
    return {video: found for video, found in told.items() if found is not None}


def _source(video: VideoKeypoints, given: dict[str, Estimate], lifted: dict[str, Lifted]) -> str:
    """Where the start of a video came from: an estimator, the lifter, or its keypoints alone."""
    if video.id in lifted:
        return "lifter"
    return "monocular" if given[video.id] is None else video.initial_format or ""


def _starts(
    body: Body,
    library: Library,
    observation: Observation,
    given: Estimate,
    params: InitialSmplParams,
) -> list[Start]:
    """Where the fit of one video begins."""
    if isinstance(given, Start):
        return [given]
    if isinstance(given, torch.Tensor):
        return [start_at_joints(body, given.to(library.R_view), observation)]
    if given is not None:
        return [start_at_joints(body, fit_rotations_to_joints(body, library, given), observation)]
    return lifted_starts(body, library, observation, params)


if __name__ == "__main__":
    raise SystemExit(stage_main("initial_smpl"))

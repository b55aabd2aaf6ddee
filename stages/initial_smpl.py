"""initial_smpl: the SMPL motion of each video by itself (section 3.2, "Initialization").

Where a monocular estimator's result is given it is the start (and, as 3D joints, evidence);
otherwise the lifter's joints are, or the 2D keypoints are matched against a library of poses seen
from all sides. Either way the start is refined by minimising the reprojection error.
"""

from __future__ import annotations

import torch

from imocap_core.artifacts.schemas import CameraMotion, InitialSmpl, Keypoints
from imocap_core.cli import stage_main
from imocap_core.motion.monocular.fit import fit_monocular
from imocap_core.motion.monocular.hypotheses import alternatives
from imocap_core.motion.monocular.library import make_library
from imocap_core.motion.monocular.starts import Start
from imocap_core.motion.observations import Observation
from imocap_core.motion.prior import load_pose_prior
from imocap_core.params import Params
from imocap_core.pipeline.stage import Context, Inputs
from imocap_core.problem.estimates import estimate_of
from imocap_core.problem.ground import grounds_of
from imocap_core.problem.motions import alternatives_of, motions_of, starts_of
from imocap_core.problem.observations import body_for, fit_of_single_views, observations_of
from imocap_core.problem.path_units import path_units
from imocap_core.problem.starts import initial_evidence, lifted_where_no_estimate, source_of, starts
from imocap_core.problem.swapped_sides import refits_of_swapped
from imocap_core.workers import at_once


def run(ctx: Context, inputs: Inputs, params: Params) -> InitialSmpl:
    """A motion for every video by itself."""
    keypoints, cameras = inputs.get(Keypoints), inputs.get(CameraMotion)
    body, prior, options = body_for(keypoints), load_pose_prior(), params.initial_smpl
    estimates = {
        v.id: estimate_of(ctx, v, torch.as_tensor(camera.R_first_from_frame))
        for v, camera in zip(keypoints.videos, cameras.videos, strict=True)
    }
    automatic = options.lifter == "auto"
    lifted = lifted_where_no_estimate(keypoints, cameras, estimates) if automatic else {}
    evidence = initial_evidence(estimates, lifted)
    weights = fit_of_single_views(keypoints, params.fit, evidence, options.shape_prior)
    observations = observations_of(body, keypoints, cameras, weights, evidence)
    ctx.progress(0.05, "looking for starts")
    library = make_library(
        body, prior, ctx.rng(), poses=options.library_poses, directions=options.library_directions
    )
    ids = [video.id for video in keypoints.videos]

    def starts_with(v: int, observation: Observation) -> list[Start]:
        estimate, joints = estimates[ids[v]], lifted.get(ids[v])
        return starts(body, library, observation, estimate, joints, options)

    units = path_units(
        body, prior, keypoints, cameras, observations, starts_with, weights, options.stride_s
    )
    if units:
        observations = observations_of(body, keypoints, cameras, weights, evidence, units)
    starts_of_all = at_once(lambda v: starts_with(v, observations[v]), range(len(ids)))
    ctx.progress(0.4, "starts of all videos")
    slowest = min(o.fps for o in observations)
    fit = fit_monocular(
        body, prior, observations, starts_of_all, weights,
        stride=max(1, round(options.stride_s * slowest)), max_steps=options.max_steps,
        progress=lambda message: ctx.progress(0.5, message),
    )  # fmt: skip
    motions = motions_of(body, fit.state, observations, keypoints)
    ctx.progress(0.8, "other motions that may explain the videos")
    alone = options.hypotheses == 1 or len(ids) == 1
    pictured = [v for v, i in enumerate(ids) if estimates[i] is None and i not in lifted]
    of_pictures = [] if alone else pictured
    hypotheses = alternatives(
        body, prior, library, observations, fit.coarse, weights,
        videos=of_pictures, count=options.hypotheses - 1,
    )  # fmt: skip
    others = alternatives_of(body, hypotheses, observations, keypoints)
    others += refits_of_swapped(
        body, prior, library, observations, keypoints, motions, fit.coarse, options, weights,
        videos=of_pictures,
    )  # fmt: skip
    return InitialSmpl(
        model=body.model.name,
        model_digest=body.model.digest,
        videos=motions,
        source={v.id: source_of(v, estimates, lifted) for v in keypoints.videos},
        starts=starts_of(ids, fit.costs),
        alternatives=others,
        grounds=grounds_of(motions, keypoints, cameras, params.fit),
        path_units=units,
    )


if __name__ == "__main__":
    raise SystemExit(stage_main("initial_smpl"))

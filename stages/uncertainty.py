"""uncertainty: standard deviations of joints and joint angles, what the videos leave open, and how
well each video is predicted by the others."""

from __future__ import annotations

from functools import partial

from imocap_core.adapters import uncertainty
from imocap_core.adapters.joint import SolvedGroup, is_one_motion, solved_groups
from imocap_core.adapters.redetection import with_second_look
from imocap_core.artifacts.schemas import (
    CameraMotion,
    InitialSmpl,
    Keypoints,
    RefineSync,
    Uncertainty,
)
from imocap_core.cli import stage_main
from imocap_core.motion.monocular.fit import Progress
from imocap_core.motion.motion_posterior import motion_posterior
from imocap_core.motion.observability import viewpoint_report
from imocap_core.motion.posterior_noise import (
    Noise,
    claimed_covariance_m2,
    claimed_rotation_sd,
    claimed_rotations_deg2,
)
from imocap_core.params import Params, UncertaintyParams
from imocap_core.pipeline.stage import Context, Inputs
from imocap_core.process import release_if_large


def run(ctx: Context, inputs: Inputs, params: Params) -> Uncertainty:
    """The posterior of the loop's result; an excluded video has one of its own."""
    inputs = with_second_look(inputs)
    keypoints, refined = inputs.get(Keypoints), inputs.get(RefineSync)
    groups = solved_groups(
        keypoints,
        inputs.get(CameraMotion),
        inputs.get(InitialSmpl),
        refined,
        params.fit,
        params.motion,
        ctx.device,
    )
    common, one_motion = refined.motion.common, refined.event is not None
    if common is not None and not one_motion:
        one_motion = is_one_motion(common.keypoint_sd_m, common.rigid_offset_sd)
    posteriors = []
    for k, group in enumerate(groups):
        progress = partial(_begin, ctx, k / len(groups), ", ".join(group.ids))
        posteriors.append(
            posterior_of(group, params.uncertainty, progress, one_motion=one_motion and k == 0)
        )
    ctx.progress(0.9, "each video predicted by the others")
    release_if_large()
    left_out = uncertainty.leave_one_out_of(groups, inputs.get(InitialSmpl).limb_errors)
    return uncertainty.uncertainty_of(posteriors, keypoints, refined, left_out)


def _begin(ctx: Context, done: float, videos: str, what: str) -> None:
    """A part of the work, which needs arrays of other sizes than the one before."""
    ctx.progress(done, f"the posterior of {videos}: {what}")
    release_if_large()


def posterior_of(
    group: SolvedGroup, params: UncertaintyParams, progress: Progress, *, one_motion: bool
) -> uncertainty.GroupPosterior:
    """Covariances and viewpoints of videos that were solved together."""
    noise, options = Noise(params), group.problem.options
    scene = group.problem.scene_of(group.solution)
    rows = partial(uncertainty.anatomical_rotations, scene.body.model)
    posterior = motion_posterior(scene, group.solution, options, noise, rows, progress)
    progress("viewpoints")
    viewpoints = viewpoint_report(
        scene, group.solution, posterior, evidence_share=noise.evidence_share(scene.fps)
    )
    lasting_m = uncertainty.lasting_residual_m(group)
    joints = partial(claimed_covariance_m2, one_motion=one_motion, lasting_m=lasting_m)
    rotations = partial(claimed_rotations_deg2, one_motion=one_motion, lasting_m=lasting_m)
    deviations = partial(claimed_rotations_deg2, one_motion=False, lasting_m=0.0)
    return uncertainty.GroupPosterior(
        group.problem.participants,
        [joints(x) for x in posterior.covariances_m2],
        [rotations(x) for x in posterior.rotations_rad2],
        [deviations(x) for x in posterior.deviations_rad2],
        [claimed_rotation_sd(sd) for sd in posterior.camera_rotation_rad],
        viewpoints,
    )


if __name__ == "__main__":
    raise SystemExit(stage_main("uncertainty"))

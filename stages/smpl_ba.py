"""smpl_ba: the motion of every video and all cameras, jointly (Eq. 8)."""

from __future__ import annotations

from imocap_core.adapters.ground import with_ground
from imocap_core.adapters.joint import problem_of
from imocap_core.artifacts.schemas import CameraMotion, InitialSmpl, Keypoints, SmplBa, Sync
from imocap_core.cli import stage_main
from imocap_core.motion.multiview.smpl_ba import solve_jointly
from imocap_core.params import Params
from imocap_core.pipeline.stage import Context, Inputs
from imocap_core.process import release_if_large


def run(ctx: Context, inputs: Inputs, params: Params) -> SmplBa:
    """One pass of SMPL-BA on the first correspondences."""

    def progress(message: str) -> None:
        ctx.progress(0.5, message)
        release_if_large()  # the next solve needs other sizes

    keypoints, cameras, sync = inputs.get(Keypoints), inputs.get(CameraMotion), inputs.get(Sync)
    problem = problem_of(
        keypoints,
        cameras,
        inputs.get(InitialSmpl),
        sync,
        params.fit,
        params.motion,
        event=bool(ctx.event()),
        device=ctx.device,
    )
    motion = solve_jointly(problem.scene, problem.start, problem.options, progress)
    result = problem.result(motion)
    return with_ground(result, keypoints, cameras, sync.excluded, params.fit)


if __name__ == "__main__":
    raise SystemExit(stage_main("smpl_ba"))

"""sync: which frames of the videos show the same moment of the action (section 3.1; Eq. 1, 2)."""

from __future__ import annotations

from imocap_core.artifacts.schemas import InitialSmpl, Keypoints, Sync
from imocap_core.cli import stage_main
from imocap_core.params import Params
from imocap_core.pipeline.stage import Context, Inputs
from imocap_core.problem.first_sync import synchronise_monocular
from imocap_core.problem.hints import hints_of


def run(ctx: Context, inputs: Inputs, params: Params) -> Sync:
    """Synchronise the monocular motions; the reference is a central video."""
    keypoints, initial = inputs.get(Keypoints), inputs.get(InitialSmpl)
    hints = hints_of(*ctx.hints(), keypoints, str(ctx.action_file()))
    ctx.progress(0.1, "comparing all pairs of frames")
    mirrored = [ctx.mirrored()[video.id] for video in keypoints.videos]
    return synchronise_monocular(
        initial, keypoints, params.sync, ctx.rng(), mirrored=mirrored, hints=hints
    )


if __name__ == "__main__":
    raise SystemExit(stage_main("sync"))

"""visibility: share of the frames in which the detector saw each joint. A stage of one's own.

It lies in stages/, and pipeline.yaml has it:

    stages:
      visibility:
        script: stages/visibility.py
        inputs: [keypoints]
        reads: []
        params: [keypoints]
"""

from imocap_core.artifacts.schemas import Artifact, Keypoints
from imocap_core.cli import stage_main
from imocap_core.params import Params
from imocap_core.pipeline.stage import Context, Inputs


class Visibility(Artifact):
    """For each video, one number a joint."""

    share_visible: dict[str, list[float]]


def run(ctx: Context, inputs: Inputs, params: Params) -> Visibility:
    """What is stored under the stage's name."""
    videos = inputs.get(Keypoints).videos
    ctx.progress(0.5, "counting visible joints")
    least = params.keypoints.min_confidence
    return Visibility(
        share_visible={v.id: (v.confidence >= least).mean(axis=0).tolist() for v in videos}
    )


if __name__ == "__main__":  # python -m stages.visibility yoga
    raise SystemExit(stage_main("visibility"))

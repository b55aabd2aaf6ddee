"""hands: fingers and wrists after the body, where the keypoints have hands."""

from __future__ import annotations

from imocap_core.adapters.hands import hands_of, hands_problem, no_hands
from imocap_core.artifacts.schemas import CameraMotion, Hands, Keypoints, RefineSync
from imocap_core.body import load_free_body
from imocap_core.cli import stage_main
from imocap_core.hands.hand_fit import FittedHands, fit_hands
from imocap_core.params import Params
from imocap_core.pipeline.stage import Context, Inputs


def run(ctx: Context, inputs: Inputs, params: Params) -> Hands:
    """Videos of one action share a hand motion and a size; others are fitted by themselves."""
    keypoints, refined = inputs.get(Keypoints), inputs.get(RefineSync)
    if all(video.hands is None for video in keypoints.videos):
        return no_hands()
    body = load_free_body(ctx.device, hands=True)
    problem = hands_problem(body, keypoints, inputs.get(CameraMotion), refined)
    fitted: dict[str, FittedHands] = {}
    sizes = []
    for k, group in enumerate(problem.groups):
        ctx.progress(k / len(problem.groups), f"hands of {', '.join(group.ids)}")
        hands, size = fit_hands(problem.skeleton, group.videos, group.timeline, group.reference)
        fitted |= dict(zip(group.ids, hands, strict=True))
        sizes.append(size)
    return hands_of(body, keypoints, refined, fitted, sizes[0])


if __name__ == "__main__":
    raise SystemExit(stage_main("hands"))

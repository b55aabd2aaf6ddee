"""hands: fingers and wrists after the body, where the keypoints have hands."""

from __future__ import annotations

import numpy as np
import torch

from imocap_core.artifacts.schemas import CameraMotion, Hands, Keypoints, RefineSync, VideoHands
from imocap_core.body import load_free_body
from imocap_core.cli import stage_main
from imocap_core.hands.fit import FittedHands, fit_hands
from imocap_core.hands.skeleton import hand_skeleton
from imocap_core.motion.multiview.timeline import Timeline
from imocap_core.params import Params
from imocap_core.pipeline.stage import Context, Inputs
from imocap_core.problem.hands import (
    arms_and_hands,
    members_of,
    timeline_of,
)
from imocap_core.rotations import log, unwrap


def run(ctx: Context, inputs: Inputs, params: Params) -> Hands:
    """Videos of one action share a motion and a size; others are looked at by themselves."""
    keypoints, refined = inputs.get(Keypoints), inputs.get(RefineSync)
    motions = {v.id: v for v in refined.motion.videos}
    if all(video.hands is None for video in keypoints.videos):
        return Hands(videos=[], model="", model_digest="", size=1.0, status="no hand keypoints")
    body = load_free_body(hands=True)
    reference = refined.sync.reference
    betas = torch.as_tensor(motions[reference].betas)
    skeleton = hand_skeleton(body.shape(betas))
    cameras = {c.id: c for c in refined.motion.cameras}
    turned = {c.id: c for c in inputs.get(CameraMotion).videos}
    videos = {
        v.id: arms_and_hands(v, turned[v.id], cameras[v.id], motions[v.id], skeleton, params.hands)
        for v in keypoints.videos
    }
    together = members_of(refined.sync)
    groups: list[tuple[list[str], Timeline | None]] = [
        ([i], None) for i in videos if i not in together
    ]
    if together:
        groups.insert(0, (together, timeline_of(refined.sync, together)))
    found: dict[str, FittedHands] = {}
    sizes = []
    for k, (ids, timeline) in enumerate(groups):
        ctx.progress(k / len(groups), f"hands of {', '.join(ids)}")
        place = ids.index(reference) if reference in ids else 0
        fitted, size = fit_hands(
            skeleton,
            [videos[i] for i in ids],
            timeline,
            place,
            params.hands,
        )
        found |= dict(zip(ids, fitted, strict=True))
        sizes.append(size)
    made = [_stored(v.id, motions[v.id].frames, found[v.id]) for v in keypoints.videos]
    shares = [f"{v.id} {100 * v.seen.mean():.0f} %" for v in made]
    return Hands(
        videos=made,
        model=body.name,
        model_digest=body.digest,
        size=sizes[0],
        status=f"seen: {', '.join(shares)} of both hands in all frames",
    )


def _stored(name: str, frames: np.ndarray, hands: FittedHands) -> VideoHands:
    return VideoHands(
        id=name,
        frames=frames,
        fingers=hands.finger_vectors.numpy(),
        wrists=unwrap(log(hands.R_wrist)).numpy(),
        points_m=hands.points_m.numpy(),
        seen=hands.seen.numpy().astype("int64"),
    )


if __name__ == "__main__":
    raise SystemExit(stage_main("hands"))

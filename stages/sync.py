"""sync: which frames of the videos show the same moment of the action (section 3.1; Eq. 1, 2)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from imocap_core.artifacts.schemas import InitialSmpl, Keypoints, Sync, SyncMap, VideoMotion
from imocap_core.sync import Settings, synchronise
from stages.harness.stage import Context, Inputs, main
from stages.params import Params, SyncParams


def run(ctx: Context, inputs: Inputs, params: Params) -> Sync:
    """Synchronise the monocular motions; the reference is the most central video."""
    keypoints, initial = inputs.get(Keypoints), inputs.get(InitialSmpl)
    ctx.progress(0.1, "comparing all pairs of frames")
    return synchronise_motions(initial.videos, keypoints, params.sync, ctx.rng())


def synchronise_motions(
    videos: Sequence[VideoMotion],
    keypoints: Keypoints,
    params: SyncParams,
    rng: np.random.Generator,
    *,
    reference: str | None = None,
) -> Sync:
    """Synchronise motions by their joints; frames without any detection are bridged.

    `videos` in the order of `keypoints`; `reference` the id of the reference video, chosen by
    centrality when None.
    """
    ids = [video.id for video in videos]
    seen = [(video.confidence > 0).max(axis=1).astype(float) for video in keypoints.videos]
    result = synchronise(
        [video.joints for video in videos],
        fps=[video.fps for video in keypoints.videos],
        settings=Settings(**params.model_dump()),
        rng=rng,
        confidence=[
            np.repeat(s[:, None], video.joints.shape[1], axis=1)
            for s, video in zip(seen, videos, strict=True)
        ],
        reference=None if reference is None else ids.index(reference),
    )
    return Sync(
        reference=ids[result.reference],
        ids=ids,
        lengths=[len(video.joints) for video in videos],
        maps=[
            SyncMap(id=name, reference_frame=frame, confidence=trust)
            for name, frame, trust in zip(
                ids, result.reference_frame, result.confidence, strict=True
            )
        ],
        method=result.cycle.method,
        centrality=result.centrality,
        status=result.status,
        affinity=result.affinity,
        relaxed=result.relaxed,
    )


if __name__ == "__main__":
    raise SystemExit(main("sync"))

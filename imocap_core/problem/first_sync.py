"""The first synchronisation: of monocular motions, chosen jointly where there are several."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from imocap_core.artifacts.schemas import CameraMotion, InitialSmpl, Keypoints, Sync
from imocap_core.params import SyncParams
from imocap_core.problem.hypotheses import choose_alternatives, chosen_motions, explained_keypoints
from imocap_core.problem.synchronisation import synchronise_motions
from imocap_core.sync import Hints


def synchronise_monocular(
    initial: InitialSmpl,
    keypoints: Keypoints,
    params: SyncParams,
    rng: np.random.Generator,
    *,
    mirrored: Sequence[bool | None],
    reference: str | None = None,
    hints: Hints | None = None,
    cameras: CameraMotion | None = None,
) -> Sync:
    """Choose every video's motion, then screen and synchronise; as of `synchronise_motions`."""
    chosen = choose_alternatives(initial, keypoints, mirrored)
    sync = synchronise_motions(
        [motion.joints for motion in chosen_motions(initial, chosen.names)],
        explained_keypoints(initial, keypoints, chosen.names),
        params,
        rng,
        reference=reference,
        mirrored=mirrored,
        hints=hints,
        cameras=cameras,
    )
    notes = [*chosen.notes, *sync.notes]
    return sync.model_copy(update={"notes": notes, "alternatives": chosen.names})

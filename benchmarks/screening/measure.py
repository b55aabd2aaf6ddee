"""What the screening decides on every scene: clean, with a stranger, with a mirrored video."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.screening.fits import FittedFilm
from benchmarks.screening.scenes import ScreeningScene
from imocap_core.adapters.hypotheses import keypoints_of_joints
from imocap_core.conventions import SMPL_JOINTS, mirror_indices
from imocap_core.params import SyncParams
from imocap_core.sync import SyncEvidence, screened
from imocap_core.sync.screening.screening import Screening


@dataclass(frozen=True)
class SceneRow:
    """One scene. Videos as v1, v2, ... of the scene; - for none."""

    scene: str
    development: bool
    videos: int
    asymmetric: bool
    clean_excluded: int  # genuine videos, of the clean scene
    clean_flipped: int
    stranger: str
    stranger_excluded: str
    mirrored: str
    mirrored_flipped: str
    mirrored_excluded: str
    wrongly_treated: int  # genuine videos excluded or flipped, of all three
    near_symmetric_flips: int  # flipped though the action is not asymmetric, of all three


def measure(scene: ScreeningScene, params: SyncParams) -> SceneRow:
    """The row of a scene."""
    clean = screening_of(scene.genuine, params)
    stranger = screening_of(scene.with_stranger(), params)
    mirrored = screening_of(scene.with_mirrored(), params)
    wrong = [
        len({*clean.excluded, *clean.flipped}),
        len({*stranger.excluded, *stranger.flipped} - {scene.replaced}),
        len({*mirrored.excluded, *mirrored.flipped} - {scene.flipped}),
    ]
    flips = sum(len(result.flipped) for result in (clean, stranger, mirrored))
    return SceneRow(
        scene=scene.name,
        development=scene.development,
        videos=len(scene.genuine),
        asymmetric=scene.is_asymmetric,
        clean_excluded=len(clean.excluded),
        clean_flipped=len(clean.flipped),
        stranger=_named([scene.replaced]),
        stranger_excluded=_named(stranger.excluded),
        mirrored=_named([scene.flipped]),
        mirrored_flipped=_named(mirrored.flipped),
        mirrored_excluded=_named(mirrored.excluded),
        wrongly_treated=sum(wrong),
        near_symmetric_flips=0 if scene.is_asymmetric else flips,
    )


def screening_of(films: Sequence[FittedFilm], params: SyncParams) -> Screening:
    """The screening of videos, as the synchronisation does it."""
    detected = [(film.keypoints.confidence > 0).max(axis=1).astype(float) for film in films]
    evidence = SyncEvidence(
        [film.poses for film in films],
        fps=[film.keypoints.fps for film in films],
        confidence=[np.repeat(frames[:, None], 24, axis=1) for frames in detected],
        twins=mirror_indices(SMPL_JOINTS),
        keypoints=[keypoints_of_joints(film.keypoints) for film in films],
    )
    return screened(evidence, params)


def _named(videos: Sequence[int]) -> str:
    return " ".join(f"v{v + 1}" for v in sorted({*videos})) or "-"

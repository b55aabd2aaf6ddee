"""Scenes put together of casts: genuine videos alone, with a stranger, with a mirrored one.

A stranger is a film of another cast, of another performer's repertoire; no walk is a stranger among
walks. Whether a mirrored video can be recognised at all is measured on the true poses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.actions.captured import video_rng
from benchmarks.screening.casts import FILMS, MIRRORED_FILMS, mirrored_performance
from benchmarks.screening.fits import FittedCast, FittedFilm
from imocap_core.sync.screening.mirror import agreed
from imocap_core.sync.screening.pose_evidence import WeightedPoses, mirror_kinds, thinned

WALKS = ("02_01", "03_01", "05_01", "07_04", "12_01")
CLIPS = (
    *("05_08", "05_18", "07_04", "05_16", "06_08", "02_10", "05_20", "13_34", "02_05", "06_06"),
    *("05_02", "06_11", "05_09", "05_17", "01_01", "05_13", "05_15", "03_01", "13_33", "06_14"),
    *("05_10", "05_12", "13_30", "06_07", "06_09", "05_14", "13_09", "02_01", "05_04", "12_01"),
    *("05_07", "02_08", "13_07", "12_02", "13_08", "05_19", "13_10", "06_12", "02_04", "05_05"),
    *("05_03", "06_15", "02_09", "05_01", "06_10", "13_01", "13_15", "05_11", "05_06", "11_01"),
)  # in an order drawn once: every part of it has all kinds
SCENES_PER_CAST = MIRRORED_FILMS
VIDEOS = (3, 9)
ASYMMETRIC = 0.25  # true margin: walks, jumps and squats have up to 0.18, other actions from 0.28
TRUE_FILMS = 3  # of a cast, that tell its true margin
MAX_RATE = 4.0


@dataclass(frozen=True)
class ScreeningScene:
    """Videos of one action, what replaces one of them, and the mirrored twin of another.

    development: whether margins were chosen on it. true_margin: by how much (logarithm) the true
    poses fit better as they are than reflected.
    """

    name: str
    development: bool
    genuine: list[FittedFilm]
    replaced: int
    stranger: FittedFilm
    flipped: int
    mirrored: FittedFilm
    true_margin: float

    @property
    def is_asymmetric(self) -> bool:
        """Whether true poses tell the action from its mirror image."""
        return self.true_margin >= ASYMMETRIC

    def with_stranger(self) -> list[FittedFilm]:
        """The videos, one of them replaced by one of another action."""
        return _replaced(self.genuine, self.replaced, self.stranger)

    def with_mirrored(self) -> list[FittedFilm]:
        """The videos, one of them mirrored."""
        return _replaced(self.genuine, self.flipped, self.mirrored)


def scenes_of(casts: Sequence[FittedCast]) -> list[ScreeningScene]:
    """Two scenes of every cast; every second cast is for development."""
    scenes = []
    for number, cast in enumerate(casts):
        margin = true_mirror_margin(cast)
        strangers = [other for other in casts if are_strangers(cast.clip, other.clip)]
        for variant in range(SCENES_PER_CAST if strangers else 0):
            rng = video_rng(f"scene {cast.clip}", variant, 0)
            scenes.append(_scene(cast, variant, strangers, rng, margin, number % 2 == 0))
    return scenes


def are_strangers(clip: str, other: str) -> bool:
    """Whether two clips show different actions beyond doubt."""
    of_one_subject = clip.split("_")[0] == other.split("_")[0]
    return not of_one_subject and not (clip in WALKS and other in WALKS)


def true_mirror_margin(cast: FittedCast) -> float:
    """Margin of true poses against their mirror images, the weakest kind of evidence."""
    joints = [film.true_joints_m for film in cast.films[:TRUE_FILMS]]
    fps = [film.keypoints.fps for film in cast.films[:TRUE_FILMS]]
    thin, weights, rates = thinned(joints, [np.ones(x.shape[:2]) for x in joints], fps)
    plain = WeightedPoses(thin, weights)
    reflected = WeightedPoses([mirrored_performance(x) for x in thin], weights)
    evidence = agreed(mirror_kinds(plain, reflected, rates, MAX_RATE))
    return float(evidence[~np.eye(len(evidence), dtype=bool)].mean())


def _scene(
    cast: FittedCast,
    variant: int,
    strangers: Sequence[FittedCast],
    rng: np.random.Generator,
    margin: float,
    development: bool,
) -> ScreeningScene:
    count = int(rng.integers(VIDEOS[0], VIDEOS[1] + 1))
    rest = [v for v in range(FILMS) if v != variant]
    videos = [variant, *rng.choice(rest, count - 1, replace=False).tolist()]
    order = rng.permutation(count)
    chosen = [videos[k] for k in order]
    other = strangers[int(rng.integers(len(strangers)))]
    return ScreeningScene(
        name=f"{cast.clip} {'ab'[variant]}",
        development=development,
        genuine=[cast.films[v] for v in chosen],
        replaced=int(rng.integers(count)),
        stranger=other.films[int(rng.integers(len(other.films)))],
        flipped=chosen.index(variant),
        mirrored=cast.mirrored[variant],
        true_margin=margin,
    )


def _replaced(films: Sequence[FittedFilm], place: int, film: FittedFilm) -> list[FittedFilm]:
    return [film if v == place else genuine for v, genuine in enumerate(films)]

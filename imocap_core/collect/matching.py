"""Occurrences of a template movement in tracks: subsequence DTW at several playback rates.

Poses as features that neither view, place, speed nor size of the picture change. A feature is a
short window of lifted poses about one moment: before, now and after. Windows are compared after the
best rotation of the whole window (Procrustes). Time is that of the action: at a quarter of the
speed, a film's frames are a quarter as far apart.

Everybody who is followed in the films, ready to be compared with a movement. A window matches a
window of the template as far as it is nearer to it than what all the films show is. Movements that
differ from everything else in the films thus need not match as closely as standing, which is near
to any standing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter1d

from imocap_core.collect.films import LongFilm, ShotTrack, shot_tracks
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.errors import WorkFailed
from imocap_core.motion.multiview.timeline import values_at
from imocap_core.motion.state import REFLECTION, TWINS
from imocap_core.params import CollectParams, KeypointsParams
from imocap_core.sync.procrustes import procrustes_distances
from imocap_core.sync.repetition import subsequence_dtw

RATE_HZ = 12.0  # samples a second of the action
WINDOW_S = 0.15  # of the action, from the middle of a window to its ends
RATES = (0.25, 0.5, 1.0, 2.0)  # playback rates; the warp covers those between them
_SLOWEST, _FASTEST = 0.2, 2.5  # playback rate of an occurrence
_MATCH_LEVEL = (
    0.6  # squared distance of poses that are alike, of that to the median pose of the films
)
MIRROR_MARGIN = 0.3  # in score, by which a mirrored match must be better
MATCHED_JOINTS = [
    SMPL_JOINTS.index(name)
    for name in (
        *("left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle"),
        *("neck", "head", "left_shoulder", "right_shoulder"),
        *("left_elbow", "right_elbow", "left_wrist", "right_wrist"),
    )
]

LEAST_SIGMA_M = 0.06  # the joints next to the pelvis do not decide alone
USUAL_M = 0.1  # error of a lifted joint that has weight 1
_ONE = [MATCHED_JOINTS.index(TWINS[joint]) for joint in MATCHED_JOINTS]
MIRRORED = [len(MATCHED_JOINTS) * part + twin for part in range(3) for twin in _ONE]


@dataclass(frozen=True)
class TrackSamples:
    """A track's windows (3 * 14 joints) in metres, if it is played `rate` times as fast as the
    action. weights: inverse variances of the lifted joints, 0 where the person is not in the
    picture. frame: of the track, of each."""

    windows: Float[np.ndarray, "N P 3"]
    weights: Float[np.ndarray, "N P"]
    frame: Float[np.ndarray, " N"]
    rate: float


def samples_of(track: ShotTrack, rate: float) -> TrackSamples:
    """Windows of a track in the action's time."""
    step = track.fps / (RATE_HZ * rate)
    frames = np.arange(0.0, len(track.joints), step)
    reach = track.fps * WINDOW_S / rate
    poses = track.joints[:, MATCHED_JOINTS]
    poses = poses - poses.mean(axis=1, keepdims=True)
    smooth = gaussian_filter1d(poses, max(0.4 * step, 0.5), axis=0, mode="nearest")
    last = len(smooth) - 1  # the first and the last pose go on beyond the ends
    parts = [
        values_at(smooth, np.clip(frames + offset, 0, last)) for offset in (-reach, 0.0, reach)
    ]
    windows = np.concatenate(parts, axis=1)
    nearest = np.minimum(np.rint(frames).astype(int), len(poses) - 1)
    sigma = np.maximum(track.sigma_m[nearest][:, MATCHED_JOINTS], LEAST_SIGMA_M)
    precision = (USUAL_M / sigma) ** 2
    weights = np.concatenate([precision * track.visible[nearest][:, None]] * 3, axis=1)
    return TrackSamples(windows, weights, frames, rate)


def at_rate(rates: Sequence[TrackSamples], rate: float) -> TrackSamples:
    """A track's samples at one of its rates."""
    return next(samples for samples in rates if samples.rate == rate)


def mirrored(samples: TrackSamples) -> TrackSamples:
    """The windows in a mirror."""
    windows, weights = samples.windows[:, MIRRORED] * REFLECTION, samples.weights[:, MIRRORED]
    return replace(samples, windows=windows, weights=weights)


def squared_distances(a: TrackSamples, b: TrackSamples) -> Float[np.ndarray, "N M"]:
    """Weighted mean squared joint distances of windows, square metres; NaN where nobody is visible.

    A joint that the lifter could only guess, hidden behind the body, counts little.
    """
    return procrustes_distances(a.windows, b.windows, a.weights, b.weights) ** 2


def part_of(samples: TrackSamples, rows: slice | Bool[np.ndarray, " N"]) -> TrackSamples:
    """Some of the windows."""
    return replace(
        samples,
        windows=samples.windows[rows],
        weights=samples.weights[rows],
        frame=samples.frame[rows],
    )


def pooled(tracks: Sequence[TrackSamples]) -> TrackSamples:
    """The windows of several tracks together."""
    return replace(
        tracks[0],
        windows=np.concatenate([samples.windows for samples in tracks]),
        weights=np.concatenate([samples.weights for samples in tracks]),
        frame=np.concatenate([samples.frame for samples in tracks]),
    )


def pose_change(windows: Float[np.ndarray, "N P 3"]) -> Float[np.ndarray, " N"]:
    """Root mean square movement of the joints within each window, metres."""
    joints = len(MATCHED_JOINTS)
    step = windows[:, 2 * joints :] - windows[:, :joints]
    return np.asarray(np.sqrt((step**2).sum(axis=-1).mean(axis=-1)))


MAX_POOL = 4000  # windows that tell how far anything is from the template


@dataclass(frozen=True)
class FilmTracks:
    """The tracks of all films, and of each its samples at every one of RATES."""

    tracks: list[ShotTrack]
    samples: list[list[TrackSamples]]

    def pool(self) -> TrackSamples:
        """Windows of everybody at the films' speed, evenly thinned out."""
        every = pooled([at_rate(rates, 1.0) for rates in self.samples])
        return part_of(every, slice(None, None, -(-len(every.frame) // MAX_POOL)))

    def of_shot(self, film: int, shot: int) -> list[int]:
        """Indices of the tracks of one shot."""
        return [i for i, t in enumerate(self.tracks) if (t.film, t.shot) == (film, shot)]


def film_tracks(films: Sequence[LongFilm], params: KeypointsParams) -> FilmTracks:
    """The people of all shots of some films. WorkFailed where there is nobody."""
    tracks = [
        track
        for number, film in enumerate(films)
        for track in shot_tracks(number, film, film.shots, params)
    ]
    if not tracks:
        raise WorkFailed(
            "nobody moves in any shot: expected films in which people are large enough to be "
            "detected"
        )
    return FilmTracks(tracks, [[samples_of(track, rate) for rate in RATES] for track in tracks])


USUAL_M2 = 0.04  # squared distance of unrelated poses, about
LEAST_M2 = 0.008  # of the background, where films show little but the action
FEW = 8  # people, whose scores say little about others
LEAST_SPREAD = 0.03  # median deviation of scores
OVERLAP = 0.3  # of the shorter: two matches of a track overlap by at most so much
WORST = -0.3  # likeness of poses as unlike as can be: one bad stretch does not decide
UNSEEN = 2.0  # times the level: squared distance to a frame without the person


@dataclass(frozen=True)
class Template:
    """Windows of the movement that is looked for, its `samples`.

    background: median squared distance of all windows of the films to each, square metres. weight:
    of each, largest where it moves, in poses that are seldom in the films.
    """

    samples: TrackSamples
    background: Float[np.ndarray, " n"]
    weight: Float[np.ndarray, " n"]

    @property
    def seconds(self) -> float:
        """How long it takes."""
        return len(self.background) / RATE_HZ


@dataclass(frozen=True)
class Match:
    """A stretch of a track that repeats the template.

    track: index. first, stop: frames of the track. rate: its speed, times the template's. score:
    1 for the template itself, 0 for what is as far away as everything else. mirrored: the mirrored
    template matches; mirror_margin: by how much more of a score.
    """

    track: int
    first: int
    stop: int
    rate: float
    score: float
    mirrored: bool
    mirror_margin: float = 0.0


def template_of(samples: TrackSamples, pool: TrackSamples) -> Template:
    """A template, and how far all windows of the films, the pool, are from it."""
    squares = squared_distances(samples, pool)
    unknown = ~np.isfinite(squares).any(axis=1)
    squares[unknown] = LEAST_M2
    background = np.maximum(np.nanmedian(squares, axis=1), LEAST_M2)
    typical = np.sqrt(np.mean(pose_change(pool.windows) ** 2))
    moving = np.minimum(pose_change(samples.windows) / max(typical, 1e-6), 1.0)
    return Template(samples, background, np.where(unknown, 0.0, moving * background / USUAL_M2))


def similarity(
    template: Template, samples: TrackSamples, *, mirror: bool = False
) -> Float[np.ndarray, "n N"]:
    """1 for equal windows, 0 at _MATCH_LEVEL times the background's distance, at least WORST, all
    times the weight of the template's window."""
    squares = squared_distances(template.samples, mirrored(samples) if mirror else samples)
    scale = template.background[:, None]
    ratio = np.where(np.isfinite(squares), squares / (_MATCH_LEVEL * scale), UNSEEN)
    return np.clip(1.0 - ratio, WORST, 1.0) * template.weight[:, None]


def matches_in(
    index: int, track: ShotTrack, rates: Sequence[TrackSamples], template: Template
) -> list[Match]:
    """The matches of a template in one track, the best first, without overlap, of any score."""
    every = [
        match
        for samples in rates
        for mirror in (False, True)
        for match in _candidates(index, track, samples, template, mirror)
    ]
    best: list[Match] = []
    for match in sorted(every, key=lambda m: -m.score):
        if all(overlap(match, other) <= OVERLAP for other in best):
            best.append(_by_side(match, every))
    return best


def score_threshold(best: Sequence[float], params: CollectParams) -> float:
    """The score from which on a match is an occurrence, from everybody's best scores.

    Most people in long films do something else; their scores tell how like the template anything
    is. Of few people nothing can be told.
    """
    if len(best) < FEW:
        return 0.5 * (params.least_score + params.certain_score)
    median = float(np.median(best))
    spread = 1.4826 * max(float(np.median(np.abs(np.array(best) - median))), LEAST_SPREAD)
    clear = median + params.least_contrast * spread
    return min(max(clear, params.least_score), params.certain_score)


def _candidates(
    index: int, track: ShotTrack, samples: TrackSamples, template: Template, mirror: bool
) -> list[Match]:
    """The best match that ends with each sample."""
    n = len(template.background)
    if 2 * len(samples.frame) < n:
        return []
    whole = float(template.weight.sum())
    total, begin = subsequence_dtw(similarity(template, samples, mirror=mirror))
    matches = []
    for end in np.flatnonzero(total[-1] > 0):
        first, last = samples.frame[begin[-1, end]], samples.frame[end]
        rate = (n - 1) / RATE_HZ * track.fps / max(last - first, 1.0)
        if _SLOWEST <= rate <= _FASTEST:
            score = float(total[-1, end]) / whole
            matches.append(Match(index, int(first), int(last) + 1, rate, score, mirror))
    return matches


def _by_side(match: Match, every: Sequence[Match]) -> Match:
    """The match as it is or mirrored: mirrored only where it is better by a clear margin."""
    there = [m for m in every if overlap(m, match) > 0.5]
    plain = [m for m in there if not m.mirrored]
    best = max(plain, key=lambda m: m.score) if plain else None
    reflected = max((m.score for m in there if m.mirrored), default=0.0)
    gain = reflected - (best.score if best is not None else 0.0)
    if not match.mirrored or best is None or gain >= MIRROR_MARGIN:
        return replace(match, mirror_margin=gain)
    return replace(best, mirror_margin=gain)


def overlap(a: Match, b: Match) -> float:
    """Frames that two matches of a track have in common, as a share of the shorter one's; at most 0
    where there are none."""
    shared = min(a.stop, b.stop) - max(a.first, b.first)
    return shared / max(1, min(a.stop - a.first, b.stop - b.first))

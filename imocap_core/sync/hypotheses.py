"""Joint choice of one monocular motion for each video, among several hypotheses.

Agreement of two hypotheses: one rotation and one warp must explain both videos' keypoints. Under
the rotation from video a to video b, a's motion is projected onto b's keypoints, and, under its
inverse, b's motion onto a's. Each direction by itself is blind to depth: reversed in a, it is made
good by a rotation the other way. Both together are not, unless the two videos look along one line.
Keypoints are the evidence, so a wrong motion cannot vouch for another beyond what pictures show.

The choice: the labelling of least energy, exactly, by branch and bound. The energy is the mean
residual of every video with the others, what each chosen motion explains its own video worse, and a
fixed cost of leaving the motion that does so best: the first motions stay unless others agree
clearly better.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations

import numpy as np
from jaxtyping import Float, Int

from imocap_core.alignment import refined_rotation
from imocap_core.sync.screening.registration import (
    Keypoints2D,
    Residuals,
    camera_directions,
    matched_residuals,
    pose_residuals,
    warp_costs,
    warp_path,
)
from imocap_core.workers import thread_map

DIRECTIONS = 96
STEPS_DEG = (8.0, 4.0, 2.0)  # of the rotation's refinement


@dataclass(frozen=True)
class CandidateMotions:
    """The motions that may explain one video.

    Attributes:
        motions: in the axes of the video's camera (y down), the likeliest first; keypoints: of
            their joints in the same frames.
        excess: objective a frame of each, above the first's.
    """

    motions: Sequence[Float[np.ndarray, "T J 3"]]
    keypoints: Keypoints2D
    excess: Float[np.ndarray, " K"]
    fps: float

    def every(self, n: int) -> CandidateMotions:
        """Every n-th frame."""
        points = Keypoints2D(self.keypoints.xy_px[::n], self.keypoints.weight[::n])
        return CandidateMotions([x[::n] for x in self.motions], points, self.excess, self.fps / n)


def pair_costs(a: CandidateMotions, b: CandidateMotions) -> Float[np.ndarray, "K_a K_b"]:
    """Mean residual of both videos' keypoints for each pair of motions, 0 to 1."""
    forth = camera_directions(DIRECTIONS)
    R_b_from_a = np.concatenate([forth, np.cross(forth[:, :1], forth[:, 1:])], axis=1)
    back = R_b_from_a.transpose(0, 2, 1)[:, :2]
    onto_b = [pose_residuals(x, b.keypoints, forth) for x in a.motions]
    onto_a = [pose_residuals(x, a.keypoints, back).transpose(0, 2, 1) for x in b.motions]
    frames = np.arange(len(b.motions[0]))
    costs = np.zeros((len(a.motions), len(b.motions)))
    for i, j in np.ndindex(costs.shape):
        both = 0.5 * (onto_b[i] + onto_a[j])
        totals = warp_costs(both)
        best = int(totals.argmin())
        path = warp_path(both[best])
        steps = float(totals[best] - both[best][frames, path].sum())
        points = Keypoints2D(a.keypoints.xy_px[path], a.keypoints.weight[path])
        onto = matched_residuals(a.motions[i][path], b.keypoints)
        residuals = partial(_both_ways, onto, matched_residuals(b.motions[j], points))
        _, refined = refined_rotation(R_b_from_a[best], residuals, STEPS_DEG)
        costs[i, j] = refined + steps / len(frames)
    return costs


def _both_ways(
    forth: Residuals, back: Residuals, R_b_from_a: Float[np.ndarray, "D 3 3"]
) -> Float[np.ndarray, " D"]:
    return 0.5 * (forth(R_b_from_a[:, :2]) + back(R_b_from_a.mT[:, :2])).mean(axis=1)


MOST_PARTIAL = 200_000  # labellings at once; beyond it the cheapest, and the choice is approximate


@dataclass(frozen=True)
class Labelling:
    """One hypothesis of each video, and the energy; videos in their order."""

    labels: tuple[int, ...]
    energy: float


def best_labellings(
    unary: Sequence[Float[np.ndarray, " _"]],
    pairs: Mapping[tuple[int, int], Float[np.ndarray, "_ _"]],
    *,
    margin: float,
) -> list[Labelling]:
    """The labelling of least energy, then all whose energy is less than ``margin`` above it.

    Args:
        unary: per video, of each hypothesis; pairs: per (u, v) with u < v, of each pair.
    """
    count = len(unary)
    limit = _descended(unary, pairs).energy + margin
    labels, energy = np.zeros((1, 0), dtype=int), np.zeros(1)
    for v in range(count):
        step = _conditional(v, unary, pairs, labels)
        options = np.arange(step.shape[1])
        labels = np.concatenate(
            [np.repeat(labels, len(options), axis=0), np.tile(options, len(labels))[:, None]],
            axis=1,
        )
        energy = (energy[:, None] + step).ravel()
        bound = energy + _remaining(v + 1, unary, pairs, labels)
        order = np.argsort(bound, kind="stable")[:MOST_PARTIAL]
        order = order[bound[order] <= limit + 1e-9]
        labels, energy = labels[order], energy[order]
    order = np.argsort(energy, kind="stable")
    near = [k for k in order if energy[k] <= energy[order[0]] + margin]
    return [Labelling(tuple(int(x) for x in labels[k]), float(energy[k])) for k in near]


def energy_of(
    labels: Sequence[int],
    unary: Sequence[Float[np.ndarray, " _"]],
    pairs: Mapping[tuple[int, int], Float[np.ndarray, "_ _"]],
) -> float:
    """Sum of the costs of single videos and of pairs."""
    single = sum(float(cost[label]) for cost, label in zip(unary, labels, strict=True))
    return single + sum(float(cost[labels[u], labels[v]]) for (u, v), cost in pairs.items())


def _descended(
    unary: Sequence[np.ndarray], pairs: Mapping[tuple[int, int], np.ndarray]
) -> Labelling:
    """A local minimum: from the first hypotheses, one video at a time while that helps."""
    labels = [0] * len(unary)
    best = energy_of(labels, unary, pairs)
    while True:
        changes = [
            (energy_of([*labels[:v], k, *labels[v + 1 :]], unary, pairs), v, k)
            for v in range(len(unary))
            for k in range(len(unary[v]))
        ]
        energy, v, k = min(changes)
        if energy >= best:
            return Labelling(tuple(labels), best)
        labels[v], best = k, energy


def _conditional(
    v: int,
    unary: Sequence[np.ndarray],
    pairs: Mapping[tuple[int, int], np.ndarray],
    labels: Int[np.ndarray, "n k"],
) -> Float[np.ndarray, "n K_v"]:
    """What each hypothesis of video v adds to labellings of the first k videos (k <= v)."""
    added = np.tile(unary[v], (len(labels), 1))
    for u in range(labels.shape[1]):
        added = added + pairs[u, v][labels[:, u]]
    return added


def _remaining(
    begin: int,
    unary: Sequence[np.ndarray],
    pairs: Mapping[tuple[int, int], np.ndarray],
    labels: Int[np.ndarray, "n k"],
) -> Float[np.ndarray, " n"]:
    """The least that videos from ``begin`` on can add to labellings of those before."""
    count = len(unary)
    bound = np.zeros(len(labels))
    for v in range(begin, count):
        bound = bound + _conditional(v, unary, pairs, labels).min(axis=1)
        bound = bound + sum(float(pairs[u, v].min()) for u in range(begin, v))
    return bound


RATE_PER_S = 15.0  # of frames that are compared
MOST_FRAMES = 80  # of the longest video
CHANGE = 0.01  # of taking another motion than the first, in shares of the keypoints' spread
PER_COST, LARGEST_EXCESS = 0.0005, 0.03  # of what it explains its own video worse
TIE = 0.005  # energies nearer to each other than that are not told apart


@dataclass(frozen=True)
class JointChoice:
    """The motion chosen for each video.

    Attributes:
        labels: index of the chosen motion of each video.
        rivals: per video, other motions that are part of a joint choice as good.
    """

    labels: tuple[int, ...]
    rivals: list[tuple[int, ...]]


def choose_jointly(videos: Sequence[CandidateMotions]) -> JointChoice:
    """The joint choice of least energy, and the choices that are no worse by `TIE`."""
    if len(videos) < 2 or all(len(v.motions) == 1 for v in videos):
        return JointChoice((0,) * len(videos), [() for _ in videos])
    longest_s = max(len(v.motions[0]) / v.fps for v in videos)
    rate = min(RATE_PER_S, MOST_FRAMES / longest_s)
    thin = [v.every(max(1, round(v.fps / rate))) for v in videos]  # a step of one is one of all
    share = 1.0 / (len(videos) - 1)
    edges = list(combinations(range(len(videos)), 2))
    costs = thread_map(lambda e: pair_costs(thin[e[0]], thin[e[1]]), edges)
    pairs = {edge: share * cost for edge, cost in zip(edges, costs, strict=True)}
    best, *others = best_labellings([_unary(v) for v in videos], pairs, margin=TIE)
    rivals = [
        tuple(sorted({o.labels[v] for o in others} - {label}))
        for v, label in enumerate(best.labels)
    ]
    return JointChoice(best.labels, rivals)


def _unary(video: CandidateMotions) -> Float[np.ndarray, " K"]:
    """Cost of each motion by itself."""
    worse = np.clip(PER_COST * video.excess, -LARGEST_EXCESS, LARGEST_EXCESS)
    return np.where(np.arange(len(worse)) > 0, worse + CHANGE, 0.0)


MEANINGS = {
    "best": "the likeliest one",
    "depth": "the one with its depth reversed",
    "facing": "the one that faces the other way",
    "sides": "the one reflected in depth, left and right swapped",
}


def sentences(
    choice: JointChoice, names: Sequence[str], motions: Sequence[Sequence[str]]
) -> list[str]:
    """One sentence per video with another motion than the first, or with an equal rival.

    Args:
        names: of the videos; motions: per video, the names of its motions.
    """
    messages = []
    for v, label in enumerate(choice.labels):
        if label > 0:
            messages.append(
                f"{names[v]} alone may show several motions: not the likeliest is used but "
                f"{_meaning(motions[v][label])}, because it agrees better with the other videos"
            )
        rivals = dict.fromkeys(_meaning(motions[v][k]) for k in choice.rivals[v])
        rivals.pop(_meaning(motions[v][label]), None)
        if rivals:
            messages.append(
                f"{names[v]} may show several motions, and the videos do not decide between the "
                f"one that is used and {', or '.join(rivals)}"
            )
    return messages


def _meaning(name: str) -> str:
    return MEANINGS.get(name, f"another fit ({name})")

"""What the other videos' motion says of a video: its left and right, its limbs.

A video's keypoints are held against the other videos' motion, at corresponding moments. Its own
motion does not vote, so that an error does not confirm itself.

Left-right swaps. Swapped sides of the whole body look, to one view, like a performer who faces the
other way, and swapped legs like other steps. Each frame's keypoints are as detected, with swapped
legs, or swapped as a whole, whichever the others' motion explains best (Viterbi; every change costs
something). A performer who really turns away turns against the others little by little, and for a
while faces a quarter another way; one whose sides were swapped faces as they do, or the opposite
way, and nothing between.

Doubtful limbs. A joint that the detector was not sure of and that lies elsewhere than the others
expect it is detected again. What it is sure of is kept: where performances differ, the others
contradict it too.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from imocap_core.alignment import rigid
from imocap_core.body.layouts import point_shares
from imocap_core.camera.projection import project_camera
from imocap_core.motion.multiview.scene import Cameras, Scene
from imocap_core.motion.multiview.timeline import sample
from imocap_core.motion.observations import Observation
from imocap_core.motion.state import MotionState
from imocap_core.sequences import runs, viterbi
from imocap_core.sync.hypotheses import STATES, with_swapped_sides
from imocap_core.sync.screening.registration import residual_share

MOMENTS = 60  # of the common time that are compared


@dataclass(frozen=True)
class KeypointEvidence:
    """Keypoints and motions of M videos at N corresponding moments.

    Attributes:
        moments: (N,) frames of the reference.
        xyz_m: (M, N, K, 3) each video's motion in its own camera's axes.
        xy_px: (M, N, K, 2); weight: (M, N, K), 0 where unknown or unmatched.
    """

    moments: Int[np.ndarray, " N"]
    xyz_m: Float[np.ndarray, "M N K 3"]
    xy_px: Float[np.ndarray, "M N K 2"]
    weight: Float[np.ndarray, "M N K"]

    def nearest_moment(self, position: Float[np.ndarray, " T"]) -> Int[np.ndarray, " T"]:
        """Index of the moment nearest to each position in the reference, 0 where that is NaN."""
        middles = (self.moments[1:] + self.moments[:-1]) / 2.0
        return np.searchsorted(middles, np.nan_to_num(position))


@dataclass(frozen=True)
class PosesOfOthers:
    """Mean pose of the other videos at each moment, about its middle, world axes.

    Attributes:
        mean_m: (N, K, 3); sd_m: (N, K) standard deviation of each keypoint.
        count: (N,) videos that show the moment.
    """

    mean_m: Float[np.ndarray, "N K 3"]
    sd_m: Float[np.ndarray, "N K"]
    count: Int[np.ndarray, " N"]


def keypoint_evidence(scene: Scene, state: MotionState, moments: int = MOMENTS) -> KeypointEvidence:
    """Evenly spaced moments of the reference."""
    keypoints = scene.keypoints
    last = keypoints.xy_px.shape[1] - 1
    frames = np.unique(np.linspace(0, last, moments).round().astype(int))
    xyz = scene.body.positions(scene.body.keypoints, state)
    rows = zip(xyz, scene.observations, scene.timeline.from_reference, strict=True)
    motions = [sample(x[: len(o.xy_px)], f[frames]).cpu().numpy() for x, o, f in rows]
    scale = keypoints.sigma_px[:, frames, None] ** 2
    return KeypointEvidence(
        frames, np.stack(motions), keypoints.xy_px[:, frames], keypoints.weight[:, frames] * scale
    )


def frame_residuals(
    pose: Float[np.ndarray, "N K 3"],
    xy_px: Float[np.ndarray, "N K 2"],
    weight: Float[np.ndarray, "N K"],
    R: Float[np.ndarray, "D 3 3"],
) -> Float[np.ndarray, "D N"]:
    """Share of each frame's keypoint spread that a rotated pose leaves, 0 to 1; 0 if unknown.

    Scaled orthographic: with keypoints x and a projected pose p, both about their weighted means,
    1 - <x, p>^2 / (<x, x> <p, p>) of the squared spread is left by the best positive scale.
    """
    w = weight[..., None]
    total = np.maximum(w.sum(1, keepdims=True), 1e-12)
    given = np.where(w > 0, xy_px, 0.0)
    x = given - (w * given).sum(1, keepdims=True) / total
    p = pose - (w * pose).sum(1, keepdims=True) / total
    cross = np.einsum("nk,nki,nkj->nij", weight, x, p)
    moment = np.einsum("nk,nki,nkj->nij", weight, p, p)
    product = np.einsum("dij,nij->dn", R[:, :2], cross)
    spread = np.einsum("dij,njk,dik->dn", R[:, :2], moment, R[:, :2])
    size = np.einsum("nk,nki,nki->n", weight, x, x)
    visible = (weight > 0).sum(1) > 3
    return np.where(visible, residual_share(product, spread, size), 0.0)


def mean_of_others(
    evidence: KeypointEvidence, R: Float[np.ndarray, "M 3 3"], v: int
) -> PosesOfOthers:
    """The other videos' poses in the world's axes, each about its own middle."""
    others = [u for u in range(len(R)) if u != v]
    world = np.einsum("mji,mnkj->mnki", R[others], evidence.xyz_m[others])
    world = world - world.mean(axis=2, keepdims=True)
    matched = np.max(evidence.weight[others] > 0, axis=2)[..., None]
    count = matched.sum(axis=0)
    mean = (matched[..., None] * world).sum(axis=0) / np.maximum(count, 1)[..., None]
    square = matched * np.square(world - mean).sum(axis=-1)
    return PosesOfOthers(mean, np.sqrt(square.sum(axis=0) / np.maximum(count, 1)), count[:, 0])


QUARTER_RAD = (np.pi / 4, 3 * np.pi / 4)  # that no swap of sides turns a body by
TURNING_SHARE, TURNING_S = 0.2, 0.27  # of a stretch: less is a fit's own turn at its two ends
RATE_PER_S = 15.0  # frames of which each is a piece of evidence by itself
SWAPPED = 0.1  # of a frame, in logarithms of the residual
FLOOR = 0.1  # share of the keypoints' spread by which performances differ without being swapped
LEGS, WHOLE = 2, 3  # states of `swapped_by_others`
CHANGE = np.array([0.0, 1.0, 0.5, 1.0])  # to or from each state: legs are swapped most often


def with_sides_of_others(scene: Scene, state: MotionState, cameras: Cameras) -> Scene:
    """The scene with left and right swapped in the frames where the other videos say so.

    Legs alone are judged by two others at least: of two videos either may have them swapped. What
    is above the hips is swapped alone only where it was before, by the choice of motions.

    Args:
        state: every video's motion in its own camera's axes.
    """
    if len(scene.observations) < 2:
        return scene
    frames = scene.timeline.from_reference.shape[1]
    evidence = keypoint_evidence(scene, state, frames)  # legs pass each other within a few
    R = cameras.R.cpu().numpy()
    names = scene.body.keypoints.names
    alone = [LEGS] if len(R) > 2 else []
    poses = scene.body.positions(scene.body.keypoints, state).cpu().numpy()
    observations = []
    for v, o in enumerate(scene.observations):
        position = scene.timeline.to_reference[v]
        pose = mean_of_others(evidence, R, v).mean_m[evidence.nearest_moment(position)]
        weight = np.where(np.isfinite(position)[:, None], o.confidence, 0.0)
        before = o.swapped_states
        possible = {0, *alone, WHOLE, *before.tolist()}
        states = swapped_states(pose, o.xy_px, weight, R[v], names, o.fps, before, possible)
        whole = (states == WHOLE) & (before != WHOLE)
        whole &= turning_frames(poses[v, : len(whole)], pose @ R[v].T, whole, o.fps)
        observations.append(swapped(o, before ^ np.where(whole, before, states), names))
    return replace(scene, observations=observations)


def with_sides(scene: Scene, states: Sequence[Int[np.ndarray, " _"]]) -> Scene:
    """The scene with left and right swapped as each video's states say (of
    `swapped_by_others`, in all)."""
    names = scene.body.keypoints.names
    rows = zip(scene.observations, states, strict=True)
    observations = [swapped(o, o.swapped_states ^ state, names) for o, state in rows]
    return replace(scene, observations=observations)


def swapped_states(
    pose: Float[np.ndarray, "T K 3"],
    xy_px: Float[np.ndarray, "T K 2"],
    weight: Float[np.ndarray, "T K"],
    R: Float[np.ndarray, "3 3"],
    names: Sequence[str],
    fps: float,
    before: Int[np.ndarray, " T"],
    possible: Iterable[int] = (0, LEGS, WHOLE),
) -> Int[np.ndarray, " T"]:
    """What of the detections has to be swapped for a pose, rotated by R, to explain them best.

    Args:
        xy_px: any value where the weight is 0; names: of the keypoints.
        before: what of them was swapped already; possible: what may be swapped in all. Both are
            states of `swapped_by_others`, as those returned are.
    """
    costs = np.full((len(pose), STATES), np.inf)
    weight = weight * point_shares(names)
    for state in possible:
        x, w = (with_swapped_sides(q, before ^ state, names) for q in (xy_px, weight))
        residual = frame_residuals(pose, x, w, R[None])[0]
        costs[:, state] = np.log(residual + FLOOR) + SWAPPED * (state > 0)
    costs *= min(1.0, RATE_PER_S / fps)
    change = np.maximum(CHANGE[:, None], CHANGE) * (1.0 - np.eye(STATES))
    steps = change + costs[1:, None]
    return viterbi(costs[0], steps)


def turning_frames(
    pose: Float[np.ndarray, "T K 3"],
    others: Float[np.ndarray, "T K 3"],
    frames: Bool[np.ndarray, " T"],
    fps: float,
) -> Bool[np.ndarray, " T"]:
    """Those of some frames, by whole stretches, in which the performer turns against the others.

    Args:
        pose, others: of the video and of the others, in the axes of the video's camera.
    """
    turning = np.zeros_like(frames)
    for first, last in runs(frames):
        stretch = slice(first, last + 1)
        R = rigid(pose[stretch], others[stretch]).R_target_from_source
        angle = Rotation.from_matrix(R).magnitude()
        quarter = (angle > QUARTER_RAD[0]) & (angle < QUARTER_RAD[1])
        least = max(TURNING_S * fps, TURNING_SHARE * (last + 1 - first))
        turning[stretch] = round(least) <= quarter.sum()
    return turning


def swapped(
    observation: Observation, states: Int[np.ndarray, " T"], names: Sequence[str]
) -> Observation:
    """The observation with its sides swapped as the states of `swapped_by_others` say."""
    if not states.any():
        return observation
    xy_px, confidence = (
        with_swapped_sides(x, states, names) for x in (observation.xy_px, observation.confidence)
    )
    in_all = observation.swapped_states ^ states
    return replace(observation, xy_px=xy_px, confidence=confidence, swapped=in_all)


LIMB_JOINTS = ("elbow", "wrist", "knee", "ankle")
SURE = 0.5  # confidence from which a detection is not doubted
LEAST_OTHERS = 2  # videos that show a moment: of two, either may be wrong
AWAY = 0.05  # distance, in sizes of the person, from where the others expect a joint,
SPREADS = 2.0  # and so many standard deviations of the others from one another


@dataclass(frozen=True)
class ExpectedPlaces:
    """Where the other videos expect a video's keypoints, in its first frame's picture.

    Attributes:
        xy_px: (T, K, 2), NaN in frames with too few counterparts.
        limit_px: (T, K) distance from there beyond which the others contradict a detection.
    """

    xy_px: Float[np.ndarray, "T K 2"]
    limit_px: Float[np.ndarray, "T K"]


def expected_by_others(scene: Scene, state: MotionState, cameras: Cameras) -> list[ExpectedPlaces]:
    """Of every video the places of its keypoints by the mean of the other videos' poses.

    Args:
        state: every video's motion in its own camera's axes; its body's middle is where the poses
            of the others are put.
    """
    evidence = keypoint_evidence(scene, state, scene.timeline.from_reference.shape[1])
    poses = scene.body.positions(scene.body.keypoints, state).cpu().numpy()
    R, K = cameras.R.cpu().numpy(), cameras.K.cpu().numpy()
    expected = []
    for v, o in enumerate(scene.observations):
        position = scene.timeline.to_reference[v]
        moments = evidence.nearest_moment(position)
        others = mean_of_others(evidence, R, v)
        middle = poses[v, : len(o.xy_px)].mean(axis=1, keepdims=True)
        place = np.zeros(3) if o.centre_m is None else o.centre_m[:, None]
        xy_px = project_camera(others.mean_m[moments] @ R[v].T + middle - place, K[v])
        sd_px = others.sd_m[moments] * K[v, 0, 0] / (middle - place)[..., 2]
        is_shown = np.isfinite(position) & (others.count[moments] >= LEAST_OTHERS)
        expected.append(
            ExpectedPlaces(
                np.where(is_shown[:, None, None], xy_px, np.nan),
                np.hypot(AWAY * o.size_px[:, None], SPREADS * sd_px),
            )
        )
    return expected


def contradicted(
    observation: Observation, expected: ExpectedPlaces, names: Sequence[str]
) -> Bool[np.ndarray, "T K"]:
    """Which limb joints were detected, with doubt, where the other videos do not have them.

    Args:
        names: of the keypoints.
    """
    away = np.linalg.norm(observation.xy_px - expected.xy_px, axis=-1)
    limbs = np.array([name.partition("_")[2] in LIMB_JOINTS for name in names])
    doubted = (observation.confidence > 0) & (observation.confidence < SURE) & limbs
    return doubted & (np.nan_to_num(away) > expected.limit_px)

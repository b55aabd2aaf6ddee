"""What SMPL-BA works on, begins at, and returns: videos, cameras, motions at common frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor

from imocap_core.camera.averaging import mean_rotation, mean_vector
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.gauss_newton import Solution, gauss_newton
from imocap_core.motion.monocular.fit import regularisers
from imocap_core.motion.multiview.timeline import (
    BeyondReference,
    Timeline,
    sample,
    sample_keypoints,
    sample_rotations,
    values_at,
)
from imocap_core.motion.observations import Observation
from imocap_core.motion.prior import PosePrior
from imocap_core.motion.state import Body, MotionState
from imocap_core.motion.terms import Term
from imocap_core.motion.terms.base import running_mean
from imocap_core.params import FitParams, MotionParams
from imocap_core.robust import geman_mcclure_weight
from imocap_core.rotations import geodesic_angle, project
from imocap_core.rotations import mean as chordal_mean


@dataclass(frozen=True)
class AlignedMotions:
    """M motions at the N frames of the reference, in their own cameras' axes or in the world's.

    Attributes:
        R_local: (M, N, 24, 3, 3); root: (M, N, 3) metres, the root joint;
        weight: (M, N) trust in the match, 0 where there is none.
    """

    R_local: Float[Tensor, "M N 24 3 3"]
    root: Float[Tensor, "M N 3"]
    weight: Float[Tensor, "M N"]


def root_positions(body: Body, state: MotionState) -> Float[Tensor, "B T 3"]:
    """The root joint, metres: SMPL's translation plus the resting root."""
    rest: Tensor = body.model.shape(state.betas).joints_rest[:, 0]
    return state.trans + rest[:, None]


@dataclass(frozen=True)
class Cameras:
    """One camera a video: ``x_cam = R x_world + t``; the world is the reference's camera axes.

    Attributes:
        R: (M, 3, 3); t: (M, 3) metres; K: (M, 3, 3) intrinsics, pixels.
    """

    R: Float[Tensor, "M 3 3"]
    t: Float[Tensor, "M 3"]
    K: Float[Tensor, "M 3 3"]

    @property
    def focal_px(self) -> Float[np.ndarray, " M"]:
        """Focal lengths."""
        return self.K[:, 0, 0].cpu().numpy()

    def in_axes_of(self, reference: int) -> Cameras:
        """The same cameras with the axes of one of them as the world's."""
        R = self.R @ self.R[reference].T
        return Cameras(R, self.t - R @ self.t[reference], self.K)


@dataclass(frozen=True)
class CommonKeypoints:
    """Keypoints of M videos at the N frames of the reference.

    Attributes:
        xy_px: (M, N, K, 2); weight: (M, N, K) 1/px^2, 0 where missing; sigma_px: (M, N) noise.
        offset_sd: (M, 6) standard deviations of each performance's per-frame rigid offset from the
            common motion (three rotations, rad, and three translations, m), or None: rigid copies.
        performers: of each video, the number of the person shown.
        centre_m: (M, N, 3) places of the cameras, each in its first frame's axes, or None: none
            of them moves.
        place_sd_m: (M, N) standard deviations of the performers' places that come of the cameras'
            uncertain paths, or None.
        shifts_m: (k, N, K, 3) of the keypoints in the world's axes, at a score of 1 in each mode
            in which the performances differ (`multiview.modes`), or None: no modes.
    """

    xy_px: Float[np.ndarray, "M N K 2"]
    weight: Float[np.ndarray, "M N K"]
    sigma_px: Float[np.ndarray, "M N"]
    offset_sd: Float[np.ndarray, "M 6"] | None = None
    performers: tuple[int, ...] = ()
    centre_m: Float[np.ndarray, "M N 3"] | None = None
    place_sd_m: Float[np.ndarray, "M N"] | None = None
    shifts_m: Float[np.ndarray, "k N K 3"] | None = None

    def moves(self, video: int) -> bool:
        """Whether the path of a video's camera is known."""
        return self.centre_m is not None and bool(np.any(self.centre_m[video]))


def common_keypoints(observations: Sequence[Observation], timeline: Timeline) -> CommonKeypoints:
    """Sample all keypoints at the reference's frames, sub-frame."""
    xy, weight, sigma = [], [], []
    rows = zip(observations, timeline.from_reference, timeline.confidence, strict=True)
    for o, position, trust in rows:
        value, confidence = sample_keypoints(o.xy_px, o.confidence, position)
        nearest = np.clip(np.nan_to_num(position).round().astype(int), 0, len(o.xy_px) - 1)
        noise = o.sigma_px[nearest]
        xy.append(value)
        weight.append(confidence * trust[:, None] / noise[:, None] ** 2)
        sigma.append(noise)
    return CommonKeypoints(
        np.stack(xy), np.stack(weight), np.stack(sigma),
        performers=tuple(o.performer for o in observations),
        centre_m=_sampled([o.centre_m for o in observations], timeline, 3),
        place_sd_m=_sampled([o.place_sd_m for o in observations], timeline),
    )  # fmt: skip


def _sampled(
    values: Sequence[Float[np.ndarray, "_ ..."] | None], timeline: Timeline, *shape: int
) -> Float[np.ndarray, "M N ..."] | None:
    """Values of every video at the reference's frames, 0 where a video has none; None where no
    video has any."""
    if all(of_video is None for of_video in values):
        return None
    sampled = []
    for of_video, position in zip(values, timeline.from_reference, strict=True):
        if of_video is None:
            sampled.append(np.zeros((len(position), *shape)))
            continue
        frame = np.clip(np.nan_to_num(position), 0, len(of_video) - 1)
        sampled.append(values_at(of_video, frame))
    return np.stack(sampled)


TOLERANCE = 1e-3  # share of the objective that the last step of a solve lowers it by


@dataclass(frozen=True)
class Scene:
    """Everything that stays fixed while SMPL-BA runs.

    Attributes:
        confidences: per video (T_v,) trust in each frame's correspondence.
        reference: index of the video whose camera is the world.
        beyond: per video, its frames that the reference does not show.
    """

    body: Body
    prior: PosePrior
    observations: Sequence[Observation]
    timeline: Timeline
    confidences: list[Float[np.ndarray, " _"]]
    reference: int
    fit: FitParams
    beyond: Sequence[BeyondReference] = ()

    @cached_property
    def keypoints(self) -> CommonKeypoints:
        """Every video's keypoints at the reference's frames."""
        return common_keypoints(self.observations, self.timeline)

    @cached_property
    def regularisers(self) -> list[Term]:
        """Of the common motion (`monocular.fit.regularisers`)."""
        shown = self.keypoints.weight.max(axis=0)
        prior = self.prior.for_keypoints(self.body.keypoints.names, [shown])
        return regularisers(self.body, prior, self.fit, self.fps)

    def aligned(self, state: MotionState) -> AlignedMotions:
        """Every video's motion at the reference's frames, in its own camera's axes."""
        root = root_positions(self.body, state)
        R, p = [], []
        for v, position in enumerate(self.timeline.from_reference):
            length = int(state.valid[v].sum())
            R.append(sample_rotations(state.R_local[v, :length], position))
            p.append(sample(root[v, :length], position))
        weight = torch.as_tensor(self.timeline.confidence).to(root)
        return AlignedMotions(torch.stack(R), torch.stack(p), weight)

    @property
    def K(self) -> Float[Tensor, "M 3 3"]:
        """Intrinsics as given or assumed."""
        return torch.as_tensor(np.stack([o.K for o in self.observations]))

    def with_intrinsics(self, cameras: Cameras) -> Scene:
        """The same scene with the intrinsics of solved cameras."""
        return replace(self, observations=with_intrinsics(self.observations, cameras))

    @property
    def performers(self) -> list[int]:
        """Of each video, the number of the person shown."""
        return [o.performer for o in self.observations]

    @property
    def fps(self) -> float:
        """Frame rate of the reference."""
        return self.observations[self.reference].fps


@dataclass(frozen=True)
class DeviationSpread:
    """Standard deviations of performances from the common motion.

    Attributes:
        keypoints_m: (M, N, K) of each keypoint, per coordinate, metres.
        offset_sd: (M, 6) of the per-frame rigid offset: three rotations (rad), three translations
            (m).
        shifts_m: (M, N, K, 3) of that, what the modes tell of each performance, in the world's
            axes, or None: no modes.
    """

    keypoints_m: Float[np.ndarray, "M N K"]
    offset_sd: Float[np.ndarray, "M 6"]
    shifts_m: Float[np.ndarray, "M N K 3"] | None = None

    @property
    def beyond_modes_m(self) -> Float[np.ndarray, "M N K"]:
        """Of each keypoint from where the modes tell that it is, per coordinate."""
        if self.shifts_m is None:
            return self.keypoints_m
        variance = self.keypoints_m**2 - np.square(self.shifts_m).mean(-1)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def of_frames(self, frames: slice) -> DeviationSpread:
        """Of some frames of the common motion."""
        shifts = None if self.shifts_m is None else self.shifts_m[:, frames]
        return replace(self, keypoints_m=self.keypoints_m[:, frames], shifts_m=shifts)


@dataclass(frozen=True)
class JointMotion:
    """What SMPL-BA returns.

    Attributes:
        state: every video's motion in its own camera's axes (batch of M).
        cameras: from the world, which is the reference's camera axes.
        common: the motion common to all at the reference's frames (batch of 1), world axes; None
            for a single video, like its spread.
        spread: how far each performance deviates from it.
        costs: the objective after each solve; status: a sentence.
        misfit: mean robust reprojection cost per keypoint of the common motion: how well the
            correspondences explain all images at once. Lower is better.
    """

    state: MotionState
    cameras: Cameras
    common: MotionState | None
    spread: DeviationSpread | None
    costs: list[float]
    status: str
    misfit: float


def correlation_frames(options: MotionParams, fps: float) -> float:
    """Frames over which errors and deviations persist: evidence of that many counts once."""
    return max(1.0, options.correlation_s * fps)


def with_intrinsics(observations: Sequence[Observation], cameras: Cameras) -> list[Observation]:
    """Observations with the intrinsics of solved cameras."""
    rows = zip(observations, cameras.K.cpu().numpy(), strict=True)
    return [replace(o, K=K) for o, K in rows]


def solve(
    terms: Sequence[Term], state: MotionState, max_steps: int, performers: Sequence[int]
) -> Solution:
    """Minimise by damped Gauss-Newton; motions of one of the ``performers`` share their shape."""
    return gauss_newton(
        terms,
        state,
        max_steps=max_steps,
        relative_tolerance=TOLERANCE,
        shared_globals=True,
        bodies=performers,
    )


CONSENSUS_RAD = 0.35  # angle to the consensus at which a rotation counts a quarter
ROUNDS = 4  # of the consensus
PATH_SCALE_M = 0.15  # Geman-McClure scale of the root paths' distances


def cameras_from_motion(scene: Scene, state: MotionState, K: Float[Tensor, "M 3 3"]) -> Cameras:
    """Rigid alignment of all videos' motions (section 3.2, "Initialization"), with intrinsics K.

    With every motion in its own camera's axes, a camera's rotation is a robust average of root
    orientations, its translation a robust mean of distances between root paths. The first consensus
    is the reference alone; each round replaces it by the consensus of all videos, so that every
    pair of videos counts.
    """
    aligned, reference = scene.aligned(state), scene.reference
    R_root = aligned.R_local[:, :, 0]
    videos = len(R_root)
    R = torch.eye(3).to(R_root).repeat(videos, 1, 1)
    weight = aligned.weight.clone()
    consensus, trust = R_root[reference], weight[reference]
    for _ in range(ROUNDS):
        for v in range(videos):
            relative = R_root[v] @ consensus.transpose(-1, -2)
            share = weight[v] * trust
            if bool((share > 0).any()):
                average = mean_rotation(relative.cpu().numpy(), share.cpu().numpy())
                R[v] = torch.as_tensor(average).to(R)
        R = R @ R[reference].transpose(-1, -2)
        R[reference] = torch.eye(3).to(R)
        in_world = R.transpose(-1, -2)[:, None] @ R_root
        consensus = chordal_mean(in_world, weight)
        angle = geodesic_angle(in_world, consensus[None])
        consensus = chordal_mean(in_world, geman_mcclure_weight(angle, CONSENSUS_RAD, prior=weight))
        trust = weight.amax(0)
    return Cameras(R, _translations(aligned, R, reference), K)


def _translations(aligned: AlignedMotions, R: Tensor, reference: int) -> Tensor:
    """(M, 3) robust mean over frames of ``root_j - R_j root_reference``."""
    path = aligned.root[reference]
    shift = aligned.root - torch.einsum("mij,nj->mni", R, path)
    share = aligned.weight * aligned.weight[reference]
    rows = []
    for v in range(len(R)):
        usable = share[v].cpu().numpy()
        if not (usable > 0).any():
            usable = np.ones_like(usable)
        rows.append(mean_vector(shift[v].cpu().numpy(), usable, scale=PATH_SCALE_M))
    t = torch.as_tensor(np.stack(rows)).to(R)
    t[reference] = 0.0
    return t


SMOOTH_FRAMES = 7  # over which agreement between videos is averaged


def to_world(aligned: AlignedMotions, cameras: Cameras) -> AlignedMotions:
    """The same motions, from their own cameras' axes into the world's."""
    R_world_from_cam = cameras.R.transpose(-1, -2)
    R_local = aligned.R_local.clone()
    R_local[:, :, 0] = R_world_from_cam[:, None] @ R_local[:, :, 0]
    centred = aligned.root - cameras.t[:, None]
    return replace(
        aligned, R_local=R_local, root=torch.einsum("mij,mnj->mni", R_world_from_cam, centred)
    )


def agreement(
    R: Float[Tensor, "M N J 3 3"], weight: Float[Tensor, "M N"]
) -> Float[Tensor, "M N J"]:
    """Geman-McClure weight of each joint's angle to the mean of the OTHER videos, averaged over
    `SMOOTH_FRAMES`, so that monocular noise in single frames changes little.

    Leaving the video itself out matters with few videos: it would otherwise vote for itself.

    Args:
        R: local rotations in common axes; weight: trust in each match, 0 gives 0.
    """
    weighted = weight[..., None, None, None] * R
    others = weighted.sum(0, keepdim=True) - weighted
    any_other = (weight.sum(0, keepdim=True) - weight) > 1e-6
    eye = torch.eye(3).to(R)
    consensus = project(torch.where(any_other[..., None, None, None], others, eye))
    angle = geodesic_angle(R, consensus).movedim(1, 2)  # (M, J, N)
    angle = running_mean(angle, SMOOTH_FRAMES // 2).movedim(2, 1)
    follows = geman_mcclure_weight(angle, CONSENSUS_RAD)
    return torch.where(any_other[..., None], follows, 1.0) * (weight > 0)[..., None]


def in_world(
    scene: Scene, state: MotionState, cameras: Cameras
) -> tuple[AlignedMotions, Float[Tensor, "M N 24"]]:
    """All videos' motions at the reference's frames in the world's axes, and the weight of each
    joint: trust in the match, and how far it follows the other videos (`agreement`)."""
    world = to_world(scene.aligned(state), cameras)
    return world, agreement(world.R_local, world.weight)


def consensus_motion(scene: Scene, state: MotionState, cameras: Cameras) -> MotionState:
    """The mean motion of all videos at the reference's frames (batch of 1, world axes). Frames that
    only one video shows continue from the last shared one, so that no limb jumps in depth.

    Args:
        state: every video's motion in its own camera's axes.
    """
    world, follows = in_world(scene, state, cameras)
    R = chordal_mean(world.R_local, follows * world.weight[..., None])
    together = (world.weight > 0).sum(dim=0) > 1
    if together.any():
        edge, alone = nearest_true(together[None])[0], world.weight.argmax(dim=0)
        frames = torch.arange(len(edge), device=edge.device)
        turned = R[edge] @ world.R_local[alone, edge].mT @ world.R_local[alone, frames]
        R = torch.where(together[:, None, None, None], R, turned)
    path = world.root[scene.reference]
    shapes = mean_shapes(state, scene.performers)
    rest = scene.body.model.shape(shapes[:1]).joints_rest[:, 0]
    valid = torch.ones(1, len(path), dtype=torch.bool, device=path.device)
    motion = MotionState.of(R[None], (path - rest)[None], shapes[:1], valid)
    return replace(motion, other_betas=shapes[None, 1:])


_APART_RAD = 0.3  # mean angle of the limbs' joints from which they differ


def starts_by_video(
    aligned: AlignedMotions, motion: MotionState, limbs: Sequence[str]
) -> list[MotionState]:
    """For each video whose limbs differ from a common motion's, that motion with its limbs. The
    motion as it is comes first; nothing where no video differs.

    Args:
        limbs: joints' names without sides.
    """
    joints = [SMPL_JOINTS.index(f"{side}_{name}") for side in ("left", "right") for name in limbs]
    common, starts = motion.R_local[0][:, joints], []
    for R_video, weight in zip(aligned.R_local[:, :, joints], aligned.weight, strict=True):
        matched, R_local = weight > 0, motion.R_local.clone()
        if matched.any() and geodesic_angle(R_video, common)[matched].mean() > _APART_RAD:
            R_local[0, :, joints] = torch.where(matched[:, None, None, None], R_video, common)
            starts.append(replace(motion, R_local=R_local))
    return [motion, *starts] if starts else []


def nearest_true(flags: Bool[Tensor, "B T"]) -> Int64[Tensor, "B T"]:
    """Index of the nearest true flag in each row, of the earlier of two; 0 in rows without one."""
    count = flags.shape[1]
    frames = torch.arange(count, device=flags.device).expand_as(flags)
    before = torch.where(flags, frames, -count).cummax(dim=1).values
    after = torch.where(flags, frames, 2 * count).flip(1).cummin(dim=1).values.flip(1)
    nearest = torch.where(frames - before <= after - frames, before, after)
    return torch.where(flags.any(dim=1, keepdim=True), nearest, 0)


def mean_shapes(state: MotionState, performers: Sequence[int]) -> Float[Tensor, "P 10"]:
    """Of each performer the mean shape of the videos that show it."""
    rows = torch.tensor(list(performers), device=state.betas.device)
    return torch.stack([state.betas[rows == p].mean(0) for p in range(max(performers) + 1)])


def shared_shapes(state: MotionState, performers: Sequence[int]) -> MotionState:
    """The mean shape of a performer's videos for every one of them."""
    return replace(state, betas=mean_shapes(state, performers)[list(performers)])

"""The initial SMPL motion of each video by itself (section 3.2, "Initialization").

Each start is refined by minimising the reprojection error with the priors that a single view
needs; the robust loss narrows meanwhile. Of several starts the one of the lowest objective is the
result; all objectives are reported. How well detections fit a body shows where the fit predicts one
limb at a time that is hidden from it.

The unit of a moving camera's path in metres: by the performer's size and feet. Structure from
motion leaves the unit of length open. With a wrong one the performer, whose size tells metres,
glides along with the camera: planted feet slide and the root's path bends. So motions are fitted at
several units, all from one start with the same picture, and the objective decides.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from imocap_core.body import PointSet
from imocap_core.body.layouts import point_shares
from imocap_core.camera.projection import normalised, project_camera
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.gauss_newton import gauss_newton, objective
from imocap_core.motion.monocular.starts import Start, interpolate_rotations
from imocap_core.motion.multiview.timeline import sample
from imocap_core.motion.observations import Observation, every, padded, per_video_view, validity
from imocap_core.motion.prior import PosePrior
from imocap_core.motion.state import Body, MotionState
from imocap_core.motion.terms import (
    FootContact,
    HingeLimits,
    JointAcceleration,
    JointEvidence,
    PathSmoothness,
    PosePriorTerm,
    PoseSmoothness,
    Reprojection,
    ShapePrior,
    Term,
)
from imocap_core.params import FitParams

Progress = Callable[[str], None]
# Scales of the robust loss, relative to the final one, with the tolerance of each: descent may
# pause at the widest; at the others it need not be exact.
COARSE = ((10.0, 3e-3), (3.0, 1e-2), (1.0, 1e-2))
TOLERANCE = 3e-3  # of the fit on all frames, which every later fit improves
ESTIMATE_SIGMAS = 3.0  # Geman-McClure scale, in standard deviations of an estimator
PRIOR_FPS = 30.0  # frame rate at which the prior's joint speeds were measured


@dataclass(frozen=True)
class CoarseFits:
    """The fits from all starts of all videos, on every ``stride``-th frame.

    Attributes:
        state: batch of all starts; costs: the objective of each; owner: the video of each.
    """

    state: MotionState
    costs: list[float]
    owner: list[int]
    stride: int

    def rows(self, video: int) -> list[int]:
        """The fits of a video, in the order of its starts."""
        return [row for row, owner in enumerate(self.owner) if owner == video]

    def best_row(self, video: int) -> int:
        """The fit of lowest objective of a video."""
        return min(self.rows(video), key=lambda row: self.costs[row])


@dataclass(frozen=True)
class MonocularFit:
    """The best fit of every video and the objectives of the alternatives.

    Attributes:
        state: batch of all videos; costs: per video, the objective of each start.
        coarse: the fits from all starts.
    """

    state: MotionState
    costs: list[list[float]]
    status: str
    coarse: CoarseFits


def regularisers(body: Body, prior: PosePrior, weights: FitParams, fps: float) -> list[Term]:
    """All terms of the objective that do not depend on the videos, at a frame rate."""
    pace = fps / PRIOR_FPS
    step = prior.velocity_rad.clamp_min(1e-3) / pace
    bend = prior.acceleration_rad.clamp_min(1e-3) / pace**2
    return [
        FootContact(body, (fps / weights.foot_speed_m_s) ** 2, 1.0),
        PosePriorTerm(prior, weights.pose_prior),
        ShapePrior.of_body(
            body.model, weights.shape_prior, weights.hidden_shape_prior, weights.size_prior
        ),
        JointAcceleration(body, fps, weights.joint_acceleration),
        HingeLimits(weights.limits),
        PoseSmoothness(
            weights.velocity / step**2, weights.acceleration / bend**2, weights.acceleration_scale
        ),
        PathSmoothness((fps / 100.0) ** 2, (fps**2 / weights.path_acceleration_m_s2) ** 2),  # m/s
    ]


def stacked(starts: Sequence[Start], valid: Bool[Tensor, "B T"]) -> MotionState:
    """One batch of starts of different lengths; padding repeats the last frame."""
    longest = valid.shape[1]

    def pad(x: Tensor) -> Tensor:
        return torch.cat([x, x[-1:].expand(longest - len(x), *x.shape[1:])])

    R_local = torch.stack([pad(s.R_local) for s in starts])
    trans = torch.stack([pad(s.trans) for s in starts])
    return MotionState.of(R_local, trans, trans.new_zeros(len(starts), 10), valid)


def evidence_term(
    body: Body, observations: Sequence[Observation], template: Tensor, weights: FitParams
) -> list[Term]:
    """The estimators' joints as a term, if any video has them; template: dtype and device."""
    if all(o.joints is None for o in observations):
        return []
    joints, given = [], []
    for o in observations:
        x = np.full((len(o.xy_px), 24, 3), np.nan) if o.joints is None else o.joints
        finite = np.asarray(np.isfinite(x).all(axis=-1))
        joints.append(np.where(finite[..., None], x, 0.0))
        given.append(finite.astype(float))
    sigma2_m2 = (weights.evidence_mm / 1000) ** 2
    weight = padded(given, template) / sigma2_m2
    return [JointEvidence(body, padded(joints, template), weight, ESTIMATE_SIGMAS)]


def fit_monocular(
    body: Body,
    prior: PosePrior,
    observations: Sequence[Observation],
    starts: Sequence[Sequence[Start]],
    weights: FitParams,
    *,
    stride: int,
    max_steps: int,
    progress: Progress = lambda _: None,
) -> MonocularFit:
    """Fit every video by itself from each of its starts and return the best fit.

    All starts are fitted on every ``stride``-th frame under a robust loss that narrows; the best of
    each video is then fitted on all frames.

    Args:
        observations: M videos; starts: the starts of each (at least one each).
        max_steps: Gauss-Newton steps of the last fit.
    """
    owner = [v for v, of_video in enumerate(starts) for _ in of_video]
    progress(f"{len(owner)} starts on one frame of {stride}")
    coarse = [every(observations[v], stride) for v in owner]
    every_start = [start for of_video in starts for start in of_video]
    flat = [Start(s.R_local[::stride], s.trans[::stride], s.cost) for s in every_start]
    state = stacked(flat, validity(coarse, flat[0].trans))
    fits = CoarseFits(*narrowed(body, prior, coarse, state, weights, COARSE), owner, stride)
    videos = range(len(observations))
    chosen = torch.tensor([fits.best_row(v) for v in videos], device=state.valid.device)
    progress("the best start of each video on all frames")
    state = all_frames(fits.state.rows(chosen), observations, stride)
    terms = monocular_terms(body, prior, observations, state.trans, weights, 1.0)
    solution = gauss_newton(terms, state, max_steps=max_steps, relative_tolerance=TOLERANCE)
    costs = [[fits.costs[row] for row in fits.rows(v)] for v in videos]
    return MonocularFit(solution.state, costs, solution.status, fits)


def narrowed(
    body: Body,
    prior: PosePrior,
    observations: Sequence[Observation],
    state: MotionState,
    weights: FitParams,
    schedule: Sequence[tuple[float, float]],
) -> tuple[MotionState, list[float]]:
    """Minima under a robust loss that narrows, and the objective of each.

    Args:
        schedule: scales of the loss, relative to the final one, each with its tolerance.
    """
    for scale, tolerance in schedule:
        terms = monocular_terms(body, prior, observations, state.trans, weights, scale)
        state = gauss_newton(terms, state, max_steps=6, relative_tolerance=tolerance).state
    return state, objective(terms, state).tolist()


def monocular_terms(
    body: Body,
    prior: PosePrior,
    observations: Sequence[Observation],
    template: Tensor,
    weights: FitParams,
    scale: float,
) -> list[Term]:
    """The whole objective of single videos.

    Args:
        template: gives dtype and device; scale: of the robust loss, relative to the final one.
    """
    view = per_video_view(observations, template)
    fps = float(np.median([o.fps for o in observations]))
    prior = prior.for_keypoints(body.keypoints.names, [o.confidence for o in observations])
    return [
        Reprojection(body, (view,), weights.robust_scale_sigma * scale),
        *regularisers(body, prior, weights, fps),
        *evidence_term(body, observations, template, weights),
    ]


def all_frames(state: MotionState, observations: Sequence[Observation], stride: int) -> MotionState:
    """A state on every ``stride``-th frame, interpolated to all frames."""
    full = []
    for v, observation in enumerate(observations):
        frames = len(observation.xy_px)
        keys = np.arange(0, frames, stride)
        R, trans = state.R_local[v, : len(keys)], state.trans[v, : len(keys)]
        position = np.minimum(np.arange(frames) / stride, len(keys) - 1)
        full.append(Start(interpolate_rotations(R, keys, frames), sample(trans, position), 0.0))
    dense = stacked(full, validity(observations, state.trans))
    return replace(dense, betas=state.betas)


# Hidden in this order, a stretch each, so that a limb is seen before and after
HIDDEN_LIMBS = ("left_shoulder", "right_hip", "right_shoulder", "left_hip")
HIDDEN_STEPS = 3  # Gauss-Newton steps from the fit with all limbs
STRETCH_S = 0.5
LEAST_STRETCHES = 4  # of a short video, whose stretches are shorter
NEAR = 0.1  # error, as a share of the height, below which a keypoint is predicted


@dataclass(frozen=True)
class Prediction:
    """Errors of predicted keypoints of one video.

    Attributes:
        error: (T, K) distance over the person's height in the picture, NaN where not predicted.
        weight: (T, K) of each keypoint, 0 where not predicted.
    """

    error: Float[np.ndarray, "T K"]
    weight: Float[np.ndarray, "T K"]

    @property
    def median(self) -> float:
        """Weighted median of the errors; NaN without any."""
        counted = self.weight > 0
        if not counted.any():
            return float("nan")
        error, weight = self.error[counted], self.weight[counted]
        order = np.argsort(error)
        total = np.cumsum(weight[order])
        return float(error[order][np.searchsorted(total, total[-1] / 2)])

    @property
    def near_share(self) -> float:
        """Share of the keypoints within `NEAR`; NaN without any."""
        total = float(self.weight.sum())
        near = float(self.weight[np.nan_to_num(self.error, nan=np.inf) < NEAR].sum())
        return near / total if total > 0 else float("nan")

    @property
    def frames(self) -> int:
        """Number of frames with a prediction."""
        return int((self.weight > 0).any(1).sum())


def predicted_limbs(
    body: Body, prior: PosePrior, observations: Sequence[Observation], state: MotionState,
    weights: FitParams,
) -> list[Prediction]:  # fmt: skip
    """Each video's limbs, hidden one at a time, from its own fit (``state``)."""
    shares = point_shares(body.keypoints.names)
    limbs = [stretches(len(o.xy_px), o.fps) % len(HIDDEN_LIMBS) for o in observations]
    rows = list(zip(observations, limbs, strict=True))
    hidden = [_without(body, o, limb) for o, limb in rows]
    terms = monocular_terms(body, prior, hidden, state.trans, weights, 1.0)
    solved = gauss_newton(terms, state, max_steps=HIDDEN_STEPS, relative_tolerance=TOLERANCE).state
    xyz = body.positions(body.keypoints, solved).cpu().numpy()
    predictions = []
    for (o, limb), points in zip(rows, xyz, strict=True):
        place = np.zeros(3) if o.centre_m is None else o.centre_m[:, None]
        xy_px = project_camera(points[: len(o.xy_px)] - place, o.K)
        is_known = hidden_points(body.keypoints, limb) & np.isfinite(o.xy_px).all(-1)
        predictions.append(compared(o, xy_px, np.where(is_known, o.confidence * shares, 0.0)))
    return predictions


def stretches(frames: int, fps: float) -> Int[np.ndarray, " T"]:
    """Number of the stretch of time that each frame is in."""
    length = max(1, min(round(STRETCH_S * fps), frames // LEAST_STRETCHES))
    return np.arange(frames) // length


def hidden_points(points: PointSet, limb: Int[np.ndarray, " T"]) -> Bool[np.ndarray, "T K"]:
    """Which points turn with each frame's limb (an index into `HIDDEN_LIMBS`)."""
    roots = [SMPL_JOINTS.index(name) for name in HIDDEN_LIMBS]
    return np.asarray(points.moved_by.cpu().numpy()[:, roots].T[limb])


def _without(body: Body, o: Observation, limb: Int[np.ndarray, " T"]) -> Observation:
    """An observation without the keypoints and the estimated joints of each frame's limb."""
    confidence = np.where(hidden_points(body.keypoints, limb), 0.0, o.confidence)
    if o.joints is None:
        return replace(o, confidence=confidence)
    is_hidden = hidden_points(body.joints, limb)[..., None]
    return replace(o, confidence=confidence, joints=np.where(is_hidden, np.nan, o.joints))


def compared(
    o: Observation, xy_px: Float[np.ndarray, "T K 2"], weight: Float[np.ndarray, "T K"]
) -> Prediction:
    """Errors of predicted keypoints, each of some weight."""
    error = np.linalg.norm(xy_px - o.xy_px, axis=-1) / o.size_px[:, None]
    weight = np.where(np.isfinite(error), weight, 0.0)
    return Prediction(np.where(weight > 0, error, np.nan), weight)


WIDE, NARROW = np.linspace(-0.8, 0.8, 9), np.linspace(-0.15, 0.15, 7)  # logarithms
STEPS = 10
PERSON_DEPTH = 0.7  # of the median distance of the background, which is the path's unit
GUESS_RANGE = 3.0
PERSON_M = 1.5  # spread of the keypoints of a person, roughly
LEAST_SD = 0.02  # relative
NOISE_PERSISTS_S = 0.3  # frames nearer than that are one piece of evidence


@dataclass(frozen=True)
class UnitEstimate:
    """Metres in a unit of the path, and its relative standard deviation."""

    unit_m: float
    relative_sd: float


def with_unit(observation: Observation, unit_m: float) -> Observation:
    """An observation whose ``centre_m`` is in the path's unit, in metres."""
    assert observation.centre_m is not None
    return replace(observation, centre_m=unit_m * observation.centre_m)


def guessed_unit(observation: Observation) -> float:
    """The unit at which a performer of usual size stays about one place.

    Args:
        observation: ``centre_m`` in the path's unit.
    """
    path = observation.centre_m
    assert path is not None
    weight = np.where(np.isfinite(observation.xy_px).all(-1), observation.confidence, 0.0)
    visible = weight.sum(axis=1) > 0
    xy = np.nan_to_num(observation.xy_px)
    middle = (weight[..., None] * xy).sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-9)[:, None]
    depth = observation.K[0, 0] * PERSON_M / observation.size_px
    place = np.column_stack([normalised(middle, observation.K), np.ones(len(middle))])
    place, path = (place * depth[:, None])[visible, :2], path[visible, :2]
    place, path = place - place.mean(axis=0), path - path.mean(axis=0)
    usual = float(np.median(depth)) / PERSON_DEPTH
    unit = -float((place * path).sum()) / max(float((path**2).sum()), 1e-9)
    return float(np.clip(unit, usual / GUESS_RANGE, usual * GUESS_RANGE))


def estimate_path_unit(
    body: Body,
    prior: PosePrior,
    observation: Observation,
    guess: float,
    starts: Sequence[Start],
    weights: FitParams,
    stride: int,
) -> UnitEstimate:
    """The unit of lowest objective, with the curvature's standard deviation.

    Args:
        observation: ``centre_m`` in the path's unit; guess: metres in it.
        starts: of the fit, with the guess; stride: every so many frames are fitted.
    """
    thin = every(observation, stride)
    guessed = with_unit(thin, guess)
    flat = [Start(s.R_local[::stride], s.trans[::stride], s.cost) for s in starts]
    views = [guessed] * len(flat)
    state = stacked(flat, validity(views, flat[0].trans))
    state, costs = narrowed(body, prior, views, state, weights, COARSE)
    best = state.rows(torch.tensor([int(np.argmin(costs))], device=state.valid.device))
    log_unit = float(np.log(guess))
    for offsets in (WIDE, WIDE / 2, NARROW):
        units = log_unit + offsets
        values, fits = _objectives(body, prior, thin, best, log_unit, units, weights)
        low = int(np.argmin(values))
        best, log_unit = fits.rows(torch.tensor([low], device=fits.valid.device)), units[low]
    curve = np.polyfit(units, values, 2)
    curvature = 2 * float(curve[0])
    if curvature > 0:
        log_unit = float(np.clip(-curve[1] / curvature, units[0], units[-1]))
    frames = max(1.0, NOISE_PERSISTS_S * thin.fps)
    sd = float(np.sqrt(2 * frames / max(curvature, 1e-6)))
    return UnitEstimate(float(np.exp(log_unit)), float(np.clip(sd, LEAST_SD, 1.0)))


def _objectives(
    body: Body,
    prior: PosePrior,
    observation: Observation,
    motion: MotionState,
    log_unit: float,
    units: Float[np.ndarray, " U"],
    weights: FitParams,
) -> tuple[Float[np.ndarray, " U"], MotionState]:
    """Objectives of fits at several units, and the fits; motion: batch of 1, of ``log_unit``."""
    views = [with_unit(observation, float(np.exp(u))) for u in units]
    copies = motion.rows(torch.zeros(len(units), dtype=torch.long, device=motion.valid.device))
    path = torch.as_tensor(observation.centre_m).to(motion.trans)
    change = torch.as_tensor(np.exp(units) - np.exp(log_unit)).to(motion.trans)
    moved = replace(copies, trans=copies.trans + change[:, None, None] * path)
    terms = monocular_terms(body, prior, views, motion.trans, weights, 1.0)
    fits = gauss_newton(terms, moved, max_steps=STEPS, relative_tolerance=1e-4).state
    return objective(terms, fits).cpu().numpy(), fits

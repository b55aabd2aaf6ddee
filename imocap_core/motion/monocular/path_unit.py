"""The unit of a moving camera's path in metres: by the performer's size and feet.

Structure from motion leaves the unit of length open. With a wrong one the performer, whose size
tells metres, glides along with the camera: planted feet slide and the root's path bends. So motions
are fitted at several units, all from one start with the same picture, and the objective decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float

from imocap_core.camera.projection import normalised
from imocap_core.motion.kinematics import Body
from imocap_core.motion.monocular.fit import COARSE, monocular_terms, narrowed, stacked
from imocap_core.motion.monocular.starts import Start
from imocap_core.motion.observations import Observation, every, validity
from imocap_core.motion.prior import PosePrior
from imocap_core.motion.solver.gauss_newton import gauss_newton
from imocap_core.motion.solver.objective import objective
from imocap_core.motion.state import MotionState
from imocap_core.params import FitParams

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

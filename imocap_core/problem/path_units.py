"""The units of moving cameras' paths in metres, before the monocular fits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from imocap_core.artifacts.schemas import CameraMotion, Keypoints, PathUnit
from imocap_core.motion.kinematics import Body
from imocap_core.motion.monocular.path_unit import estimate_path_unit, guessed_unit, with_unit
from imocap_core.motion.monocular.starts import Start
from imocap_core.motion.observations import Observation
from imocap_core.motion.prior import PosePrior
from imocap_core.params import FitParams


def path_units(
    body: Body,
    prior: PosePrior,
    keypoints: Keypoints,
    cameras: CameraMotion,
    observations: Sequence[Observation],
    starts_of: Callable[[int, Observation], list[Start]],
    weights: FitParams,
    stride_s: float,
) -> list[PathUnit]:
    """The unit of every camera whose path is known.

    Args:
        observations: of all videos, without paths; starts_of: starts of a video (by its index)
            with an observation that has its path.
    """
    units = []
    for v, (video, camera) in enumerate(zip(keypoints.videos, cameras.videos, strict=True)):
        if not len(camera.path):
            continue
        unitless = replace(observations[v], centre_m=camera.path, place_sd_m=None)
        guess = guessed_unit(unitless)
        starts = starts_of(v, with_unit(unitless, guess))
        stride = max(1, round(stride_s * video.fps))
        unit = estimate_path_unit(body, prior, unitless, guess, starts, weights, stride)
        units.append(PathUnit(id=video.id, unit_m=unit.unit_m, relative_sd=unit.relative_sd))
    return units

"""Mean joint angles over the performances of a result."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.biomechanics.joint_angles import angle_names
from imocap_core.biomechanics.mean_curve import MeanCurve, mean_curve
from imocap_core.result.result import ActionResult
from imocap_core.result.video_angles import video_angles


@dataclass(frozen=True, eq=False)
class MeanAngles:
    """Joint angles over the N moments of the common time axis.

    phase_s (N,): seconds of the reference. curves: mean and standard deviation over the
    performances, by name.
    """

    phase_s: Float[np.ndarray, " N"]
    curves: dict[str, MeanCurve]


def mean_angles(result: ActionResult) -> MeanAngles:
    """Mean joint angles of a result on the common time axis, in a world whose y points up."""
    each = [video_angles(video) for video in result]
    inside = [video.inside for video in result]
    curves = {n: mean_curve([a.angles_deg[n] for a in each], inside) for n in angle_names()}
    return MeanAngles(result.videos[0].phase_s, curves)

"""Joint angles of compared performances, and of two performers, at common moments."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.biomechanics.joint_angles import joint_angles_deg
from imocap_core.biomechanics.mean_curve import MeanCurve, mean_curve, near
from imocap_core.compare.compare import Technique, TechniquePair
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.motion.multiview.common_time import values_at

Curves = dict[str, MeanCurve]
OF_SIDES = (
    "hip_flexion",
    "hip_adduction",
    "knee_flexion",
    "ankle_dorsiflexion",
    "shoulder_elevation",
    "elbow_flexion",
)
SHOWN = (
    *(f"{side}_{name}" for name in OF_SIDES for side in ("left", "right")),
    "trunk_flexion",
    "trunk_right_bending",
    "trunk_left_rotation",
    "pelvis_tilt",
)
"""Those that keypoints of a body determine and that have one plain meaning."""


@dataclass(frozen=True, eq=False)
class TechniqueAngles:
    """Angles at N moments by name: mean and deviation over the performances, and each of these.

    each (M, N): degrees, NaN where a performance does not show the moment.
    """

    mean: Curves
    each: dict[str, Float[np.ndarray, "M N"]]


def technique_angles(t: Technique) -> TechniqueAngles:
    """Angles of an action's performances, at its moments."""
    rest = t.performances.shaped.joints_rest.numpy()[: len(SMPL_JOINTS)]
    of_each = [joint_angles_deg(in_smpl(R), rest) for R in t.instances.R_local]
    inside = list(t.instances.inside)
    mean = {name: mean_curve([a[name] for a in of_each], inside) for name in SHOWN}
    each = {
        name: np.stack(
            [
                near(np.where(i, a[name], np.nan), mean[name].mean_deg)
                for a, i in zip(of_each, inside, strict=True)
            ]
        )
        for name in SHOWN
    }
    return TechniqueAngles(mean, each)


def pair_angles(pair: TechniquePair) -> tuple[Curves, Curves]:
    """Mean and deviation of both performers' angles, at the pair's moments."""
    first, second = technique_angles(pair.first).mean, technique_angles(pair.second).mean
    clock = pair.second.instances.phase_s
    frame = np.interp(pair.second_s, clock, np.arange(len(clock)))
    of_first = {
        name: MeanCurve(c.mean_deg[pair.index], c.sd_deg[pair.index], c.n[pair.index])
        for name, c in first.items()
    }
    of_second = {
        name: MeanCurve(
            near(values_at(c.mean_deg, frame), of_first[name].mean_deg),
            values_at(c.sd_deg, frame),
            c.n[np.rint(frame).astype(np.int64)],
        )
        for name, c in second.items()
    }
    return of_first, of_second


def in_smpl(R_local: Float[np.ndarray, "N J 3 3"]) -> Float[np.ndarray, "N 24 3 3"]:
    """Rotations of SMPL's first J joints with the others at rest."""
    R = np.tile(np.eye(3), (len(R_local), len(SMPL_JOINTS), 1, 1))
    R[:, : R_local.shape[1]] = R_local
    return R

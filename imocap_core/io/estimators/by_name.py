"""The readers of monocular 3D estimates, by the name that action.yaml gives their format."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float

from imocap_core.io.detectors.mediapipe import read_mediapipe_world
from imocap_core.io.estimators.estimates import PerformerBoxes
from imocap_core.io.estimators.gvhmr import read_gem, read_gvhmr
from imocap_core.io.estimators.hmmr import read_hmmr
from imocap_core.io.estimators.joints_npz import JointsEstimate, read_joints_npz
from imocap_core.io.estimators.metrabs import read_metrabs
from imocap_core.io.estimators.multihmr import read_multihmr
from imocap_core.io.estimators.nlf import read_nlf
from imocap_core.io.estimators.phalp import read_phalp
from imocap_core.io.estimators.prompthmr import read_prompthmr
from imocap_core.io.estimators.sam3d_body import read_sam3d_body
from imocap_core.io.estimators.tram import read_tram
from imocap_core.io.estimators.vibe import read_vibe
from imocap_core.io.estimators.wham import read_wham


def _joints_npz(path: Path, performer: PerformerBoxes) -> JointsEstimate:
    return read_joints_npz(path, performer.frames)


# Joint rotations in camera axes, NaN where there is no estimate.
ROTATIONS: dict[str, Callable[[Path, PerformerBoxes], Float[np.ndarray, "T 24 3 3"]]] = {
    "hmr2": read_phalp,
    "tokenhmr": read_phalp,
    "wham": read_wham,
    "gvhmr": read_gvhmr,
    "gem": read_gem,
    "prompthmr": read_prompthmr,
    "vibe": read_vibe,
    "hmmr": read_hmmr,
    "tram": read_tram,
    "nlf": read_nlf,
    "multihmr": read_multihmr,
}
# Joints (T, J, 3) metres in camera axes.
JOINTS: dict[str, Callable[[Path, PerformerBoxes], JointsEstimate]] = {
    "joints_npz": _joints_npz,
    "sam3d_body": read_sam3d_body,
    "metrabs": read_metrabs,
    "mediapipe_world": read_mediapipe_world,
}

"""Body surfaces of an artifact's parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from imocap_core.artifacts.schemas import VideoMotion
from imocap_core.body import Model
from imocap_core.evaluate.body_points import posed_body


def surfaces(
    model: Model, motion: VideoMotion, frames: Sequence[int]
) -> Float[np.ndarray, "F V 3"]:
    """Vertices at F frames (indices) of a motion, in its camera's axes."""
    return np.asarray(posed_body(model, motion, list(frames)).mesh().vertices.numpy())

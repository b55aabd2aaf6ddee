"""How a straight upper arm is turned about itself: as bent arms of its elevation are.

People turn their arms outwards as they raise them. Bones alone do not show it where the elbow is
straight, so the mean over the bent arms of the training clips stands in
(tools/measure_arm_twist.py; spread 18 to 39 degrees).
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float

from benchmarks.synthetic.captured_rotations import shortest_rotations
from imocap_core.rotations import exp

ELEVATION_DEG = (-75.0, -45.0, -15.0, 15.0, 45.0)
TWIST_DEG = (5.0, -8.0, -33.0, -56.0, -75.0)
"""Of a left arm, about its bone, from the shortest turn out of the T-pose."""


def natural_arm(
    bone: Float[np.ndarray, "3"], direction: Float[np.ndarray, "T 3"]
) -> Float[np.ndarray, "T 3 3"]:
    """Rotations of an upper arm in the chest's axes: its bone to a direction, twisted as bent arms
    of that elevation are in the mean."""
    elevation = np.degrees(np.arcsin(np.clip(direction[:, 1], -1.0, 1.0)))
    twist = np.sign(bone[0]) * np.radians(np.interp(elevation, ELEVATION_DEG, TWIST_DEG))
    turned = exp(torch.as_tensor(twist[:, None] * direction)).numpy()
    rotations: np.ndarray = turned @ shortest_rotations(bone / np.linalg.norm(bone), direction)
    return rotations

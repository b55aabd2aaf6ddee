"""Correction of a detector's marks of shoulders and hips.

Where a detector marks a shoulder or a hip depends on view and pose; a layout has the points of the
body at which its marks lie on average. Small networks tell the shift of the left shoulder and of
the left hip from limb and trunk in the picture; those of the right side are the mirrored picture's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.conventions import mirror_indices
from imocap_core.marks.features import POINTS, filled_in_time, left_limb

FLIP = np.array([-1.0, 1.0])  # of coordinates in a mirrored picture


@dataclass(frozen=True)
class ShiftNetwork:
    """Two hidden layers with tanh, from standardised features to the shift of one mark.

    Attributes:
        mean, scale: of the features. weights, biases: of the layers, inputs first.
    """

    mean: Float[np.ndarray, " F"]
    scale: Float[np.ndarray, " F"]
    weights: tuple[Float[np.ndarray, "_ _"], ...]
    biases: tuple[Float[np.ndarray, " _"], ...]

    def shift(self, features: Float[np.ndarray, "T F"]) -> Float[np.ndarray, "T 2"]:
        """From the detected to the layout's mark, in units of the body's spread."""
        values = (features - self.mean) / self.scale
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            values = np.tanh(values @ weight.T + bias)
        return np.asarray(values @ self.weights[-1].T + self.biases[-1])


MarkCorrection = Mapping[str, ShiftNetwork]  # by end of the trunk


def corrected_marks(
    xy_px: Float[np.ndarray, "T K 2"], names: Sequence[str], correction: MarkCorrection
) -> Float[np.ndarray, "T K 2"]:
    """Keypoints whose shoulders and hips are moved to the marks of their layout.

    Missing points count as interpolated over time, and stay missing; keypoints without one of
    `POINTS` in any frame stay as they are.
    """
    names, twins = list(names), list(mirror_indices(names))
    if not set(POINTS) <= set(names):
        return xy_px
    filled = filled_in_time(xy_px)
    if not np.isfinite(filled[:, [names.index(name) for name in POINTS]]).all():
        return xy_px
    corrected = xy_px.copy()
    for side, pose_px, flip in (("left", filled, 1.0), ("right", filled[:, twins] * FLIP, FLIP)):
        for end, network in correction.items():
            limb = left_limb(pose_px, names, end)
            shift_px = network.shift(limb.features) * limb.spread_px[:, None]
            corrected[:, names.index(f"{side}_{end}")] += flip * shift_px
    return corrected

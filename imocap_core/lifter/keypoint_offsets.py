"""Corrections of where a detector marks shoulders and hips, from the pose in the picture.

Where a detector marks a shoulder or a hip depends on view and pose; a layout has the points of the
body at which its marks lie on average. Small networks tell the shift of the left shoulder and of
the left hip from limb and trunk in the picture; those of the right side are the mirrored picture's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from pathlib import Path

import numpy as np
from jaxtyping import Float
from safetensors import SafetensorError
from safetensors.numpy import load, save

from imocap_core.conventions import SIDES, mirror_indices

LIMBS = {"shoulder": ("elbow", "wrist"), "hip": ("knee", "ankle")}  # trunk's ends: what they carry
TRUNK = tuple(LIMBS)  # whose marks are corrected
POINTS = (*(f"{side}_{p}" for side in SIDES for end in TRUNK for p in (end, *LIMBS[end])), "nose")
FEATURES = 12


@dataclass(frozen=True)
class LeftLimb:
    """The left limb of an end of the trunk, and the trunk, in units of the body's spread.

    Attributes:
        features: (T, 12) x and y of six vectors: from the end to the limb's joints, between the
            shoulders, between the hips, along the trunk, from it to the nose.
        spread_px: (T,) root mean square distance of `POINTS` from their mean.
    """

    features: Float[np.ndarray, "T 12"]
    spread_px: Float[np.ndarray, " T"]


def left_limb(xy_px: Float[np.ndarray, "T K 2"], names: Sequence[str], end: str) -> LeftLimb:
    """The input for the left side of an end of the trunk, of finite keypoints of some names."""
    point = {name: xy_px[:, list(names).index(name)] for name in POINTS}
    left, right = (
        {name: point[f"{side}_{name}"] for part in TRUNK for name in (part, *LIMBS[part])}
        for side in SIDES
    )
    shoulders, hips = ((left[part] + right[part]) / 2 for part in TRUNK)
    vectors = [left[name] - left[end] for name in LIMBS[end]]
    vectors += [left[part] - right[part] for part in TRUNK]
    vectors += [shoulders - hips, point["nose"] - shoulders]
    every = np.stack(list(point.values()), axis=1)
    away = every - every.mean(axis=1, keepdims=True)
    spread = np.maximum(np.sqrt((away**2).sum(axis=-1).mean(axis=1)), 1e-6)
    return LeftLimb(np.concatenate(vectors, axis=1) / spread[:, None], spread)


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
    filled = xy_px.copy()
    every = np.arange(len(xy_px))
    for k, axis in np.ndindex(*xy_px.shape[1:]):
        column = xy_px[:, k, axis]
        rows = np.flatnonzero(np.isfinite(column))
        if len(rows):
            filled[:, k, axis] = np.interp(every, rows, column[rows])
    if not np.isfinite(filled[:, [names.index(name) for name in POINTS]]).all():
        return xy_px
    corrected = xy_px.copy()
    for side, pose_px, flip in (("left", filled, 1.0), ("right", filled[:, twins] * FLIP, FLIP)):
        for end, network in correction.items():
            limb = left_limb(pose_px, names, end)
            shift_px = network.shift(limb.features) * limb.spread_px[:, None]
            corrected[:, names.index(f"{side}_{end}")] += flip * shift_px
    return corrected


LAYOUTS = ("blazepose33",)  # that have a correction
METADATA = {"licence": "Apache-2.0", "record": "docs/detection.md"}
LAYERS = 3


@lru_cache(maxsize=4)
def load_correction(layout: str) -> MarkCorrection | None:
    """The packaged networks of a layout; None where it has none."""
    if layout not in LAYOUTS:
        return None
    name = f"{layout}.safetensors"
    content = (resources.files("imocap_core.lifter") / "data" / name).read_bytes()
    return read_weights(content, name)


def read_weights(content: bytes, name: str) -> MarkCorrection:
    """The networks of a weights file. ValueError names the file when it is damaged or unfit."""
    try:
        arrays = {key: array.astype(np.float64) for key, array in load(content).items()}
        networks = {end: _network(arrays, end) for end in TRUNK}
        for network in networks.values():
            if network.shift(np.zeros((1, FEATURES))).shape != (1, 2):
                raise ValueError("weights of another shape")
    except (SafetensorError, KeyError, ValueError) as error:
        raise ValueError(f"{name}: expected a mark correction's weights, got {error}") from None
    return networks


def write_weights(path: Path, correction: MarkCorrection) -> None:
    """Write networks as float32."""
    arrays: dict[str, np.ndarray] = {}
    for end, network in correction.items():
        arrays |= {f"{end}.mean": network.mean, f"{end}.scale": network.scale}
        layers = zip(network.weights, network.biases, strict=True)
        for layer, (weight, bias) in enumerate(layers):
            arrays |= {f"{end}.weight{layer}": weight, f"{end}.bias{layer}": bias}
    single = {name: np.ascontiguousarray(array, np.float32) for name, array in arrays.items()}
    path.write_bytes(save(single, METADATA))


def _network(arrays: dict[str, np.ndarray], end: str) -> ShiftNetwork:
    return ShiftNetwork(
        arrays[f"{end}.mean"],
        arrays[f"{end}.scale"],
        tuple(arrays[f"{end}.weight{layer}"] for layer in range(LAYERS)),
        tuple(arrays[f"{end}.bias{layer}"] for layer in range(LAYERS)),
    )

"""The shipped weights by keypoint layout: safetensors files."""

from __future__ import annotations

from functools import lru_cache
from importlib import resources
from pathlib import Path

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load, save

from imocap_core.marks.correction import MarkCorrection, ShiftNetwork
from imocap_core.marks.features import FEATURES, TRUNK

LAYOUTS = ("blazepose33",)  # that have a correction
METADATA = {"licence": "Apache-2.0", "record": "docs/detection.md"}
LAYERS = 3


@lru_cache(maxsize=4)
def load_correction(layout: str) -> MarkCorrection | None:
    """The packaged networks of a layout; None where it has none."""
    if layout not in LAYOUTS:
        return None
    name = f"{layout}.safetensors"
    content = (resources.files("imocap_core.marks") / "data" / name).read_bytes()
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

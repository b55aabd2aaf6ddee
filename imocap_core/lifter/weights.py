"""The shipped weights: a safetensors file of float16 numbers."""

from __future__ import annotations

from functools import lru_cache
from importlib import resources
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save

from imocap_core.lifter.network import Lifter

NAME = "lifter.safetensors"
METADATA = {"licence": "Apache-2.0", "record": "docs/lifter.md"}


@lru_cache(maxsize=2)
def load_lifter(device: torch.device | str = "cpu") -> Lifter:
    """The packaged network, ready for inference (float32, no gradients)."""
    source = resources.files("imocap_core.lifter") / "data" / NAME
    return read_weights(source.read_bytes(), NAME).to(device)


def read_weights(content: bytes, name: str) -> Lifter:
    """The network of a weights file. ValueError names the file when it is damaged or unfit."""
    network = Lifter()
    try:
        network.load_state_dict(load(content))
    except (SafetensorError, RuntimeError) as error:  # torch: a missing name or another shape
        raise ValueError(f"{name}: expected the lifter's weights, got {error}") from None
    return network.eval().requires_grad_(False)


def write_weights(path: Path, network: Lifter) -> None:
    """Write a network's weights as float16."""
    halves = {
        name: weight.detach().cpu().to(torch.float16).contiguous()
        for name, weight in network.state_dict().items()
    }
    path.write_bytes(save(halves, METADATA))

"""The shipped weights: safetensors, read and written by hand (8 bytes of length, JSON, numbers)."""

from __future__ import annotations

import json
from functools import lru_cache
from importlib import resources
from pathlib import Path

import numpy as np
import torch

from imocap_core.lifter.network import Lifter

NAME = "lifter.safetensors"


@lru_cache(maxsize=1)
def load_lifter() -> Lifter:
    """The packaged network, ready to answer (float32, no gradients)."""
    source = resources.files("imocap_core.lifter") / "data" / NAME
    network = Lifter()
    tensors = {k: torch.as_tensor(v) for k, v in parse(source.read_bytes(), NAME).items()}
    network.load_state_dict(tensors)
    return network.eval().requires_grad_(False)


def parse(data: bytes, name: str) -> dict[str, np.ndarray]:
    """Arrays (float32) of a safetensors file of float16 numbers.

    ValueError names the file, the field, what was expected and what came.
    """
    length = int.from_bytes(data[:8], "little")
    if not 2 <= length <= len(data) - 8:
        raise ValueError(f"{name}: header: expected at most {len(data) - 8} bytes, got {length}")
    try:
        header = json.loads(data[8 : 8 + length])
    except ValueError as error:
        raise ValueError(f"{name}: header: expected JSON, got {error}") from None
    body = data[8 + length :]
    found = {}
    for key, entry in header.items():
        if key == "__metadata__":
            continue
        first, last = entry["data_offsets"]
        count = int(np.prod(entry["shape"], dtype=np.int64))
        if entry["dtype"] != "F16" or not 0 <= first <= last <= len(body):
            raise ValueError(
                f"{name}: {key}: expected F16 within {len(body)} bytes, got {entry['dtype']} at "
                f"{first} to {last}"
            )
        if last - first != 2 * count:
            raise ValueError(f"{name}: {key}: expected {2 * count} bytes, got {last - first}")
        flat = np.frombuffer(body[first:last], "<f2").astype(np.float32)
        found[key] = flat.reshape(entry["shape"])
    return found


def dump(arrays: dict[str, np.ndarray], told: dict[str, str]) -> bytes:
    """The file of some arrays as float16; `told`: what its metadata say."""
    header: dict[str, object] = {"__metadata__": told}
    body = b""
    for key, array in sorted(arrays.items()):
        raw = np.ascontiguousarray(array, "<f2").tobytes()
        offsets = [len(body), len(body) + len(raw)]
        header[key] = {"dtype": "F16", "shape": list(array.shape), "data_offsets": offsets}
        body += raw
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    return len(text).to_bytes(8, "little") + text + body


def write_weights(path: Path, network: Lifter) -> None:
    """Write a network's weights."""
    arrays = {k: v.detach().cpu().numpy() for k, v in network.state_dict().items()}
    path.write_bytes(dump(arrays, {"licence": "Apache-2.0", "record": "docs/lifter.md"}))

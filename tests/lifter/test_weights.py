"""The file of weights: read back as written, and refused with a sentence when it is damaged."""

from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from imocap_core.lifter.lifter_network import Lifter, load_lifter, read_weights, write_weights


@pytest.fixture(scope="module")
def content(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = Path(tmp_path_factory.mktemp("weights") / "some.safetensors")
    write_weights(path, load_lifter())
    return path.read_bytes()


def test_read_as_written(content: bytes) -> None:
    weights, original = (n.state_dict() for n in (read_weights(content, "x"), load_lifter()))
    assert weights.keys() == original.keys() == Lifter().state_dict().keys()
    for name, weight in original.items():
        assert weights[name].dtype == torch.float32
        torch.testing.assert_close(weights[name], weight, rtol=0, atol=0)


@pytest.mark.parametrize(
    "damage",
    [
        lambda d: d[:4],
        lambda d: d[:8] + b"}" + d[9:],
        lambda d: d[:-3],
        lambda d: d.replace(b"F16", b"F64"),
        lambda d: d.replace(b"first.bias", b"final.bias"),
        lambda d: d.replace(b"[256]", b"[255]"),
    ],
)
def test_damage_is_named(damage: Callable[[bytes], bytes], content: bytes) -> None:
    with pytest.raises(ValueError, match=r"some\.safetensors: expected the lifter's weights, got"):
        read_weights(damage(content), "some.safetensors")

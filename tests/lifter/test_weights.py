"""The file of weights: read back as written, and refused with a sentence when it is damaged."""

import json
from collections.abc import Callable

import numpy as np
import pytest

from imocap_core.lifter.weights import dump, parse

ARRAYS = {"a": np.arange(6, dtype=np.float32).reshape(2, 3), "b.c": np.float32([0.5])}


def test_read_as_written() -> None:
    found = parse(dump(ARRAYS, {"licence": "Apache-2.0"}), "x")
    assert found.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(found[name], array)


def test_the_format_is_that_of_safetensors() -> None:
    data = dump(ARRAYS, {})
    length = int.from_bytes(data[:8], "little")
    header = json.loads(data[8 : 8 + length])
    assert header["a"] == {"dtype": "F16", "shape": [2, 3], "data_offsets": [0, 12]}
    assert len(data) == 8 + length + 14


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda d: d[:4], "header: expected at most"),
        (lambda d: d[:8] + b"}" + d[9:], "expected JSON"),
        (lambda d: d[:-3], "a: expected F16 within 11 bytes"),
        (lambda d: d.replace(b"F16", b"F64"), "F64"),
        (lambda d: d.replace(b"[2, 3]", b"[2, 2]"), "a: expected 8 bytes, got 12"),
    ],
)
def test_damage_is_named(damage: Callable[[bytes], bytes], said: str) -> None:
    with pytest.raises(ValueError, match=said) as caught:
        parse(damage(dump(ARRAYS, {})), "some.safetensors")
    assert "some.safetensors" in str(caught.value)

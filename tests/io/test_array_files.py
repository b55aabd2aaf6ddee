"""Pickles give back what was put in, and crafted or damaged ones are refused without harm."""

import pickle
from collections import OrderedDict, defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from imocap_core import unpickle
from imocap_core.io.array_files import read_results
from tests.io import made_estimates as made
from tests.reduced import Reduced


def content() -> dict[str, Any]:
    shared = np.arange(6.0).reshape(2, 3)
    results: defaultdict[int, dict[str, Any]] = defaultdict(dict)
    results[3] = {"x": shared, "again": [shared, shared.T]}
    return {
        "results": results,
        "fortran": np.asfortranarray(np.arange(12).reshape(3, 4)),
        "big end first": np.arange(5, dtype=">f4"),
        "objects": np.array([{"y": np.ones(2)}, None], dtype=object),
        "names": np.array(["left", "right"]),
        "flags": np.array([True, False]),
        "empty": np.zeros((0, 3)),
        "single": np.array(4.0),
        "number": np.float32(2.5),
        "tensor": torch.arange(12.0).view(3, 4)[1:, ::2],
        "ordered": OrderedDict(a=(1, 2.5, "b", None, True)),
        ("v", 1): np.ones(3, np.float32),
    }


def check(result: Any) -> None:
    expected = content()
    assert set(result) == set(expected)
    np.testing.assert_array_equal(result["results"][3]["again"][1], expected["results"][3]["x"].T)
    for name in ("fortran", "big end first", "names", "flags", "empty", "single", ("v", 1)):
        np.testing.assert_array_equal(result[name], expected[name])
    np.testing.assert_array_equal(result["tensor"], expected["tensor"].numpy())
    np.testing.assert_array_equal(result["objects"][0]["y"], np.ones(2))
    assert result["number"] == 2.5
    assert result["ordered"]["a"] == [1, 2.5, "b", None, True]


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_every_protocol(protocol: int, tmp_path: Path) -> None:
    path = tmp_path / "a.pkl"
    path.write_bytes(pickle.dumps(content(), protocol=protocol))
    check(read_results(path))


@pytest.mark.parametrize("compress", [False, True])
def test_joblib(compress: bool, tmp_path: Path) -> None:
    check(read_results(made.dump_joblib(content(), tmp_path / "a.pkl", compress=compress)))


def test_npy_of_objects_and_of_numbers(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array(content(), dtype=object), allow_pickle=True)
    check(read_results(tmp_path / "a.npy"))
    np.save(tmp_path / "b.npy", np.eye(3))
    np.testing.assert_array_equal(read_results(tmp_path / "b.npy"), np.eye(3))


@pytest.mark.parametrize("new", [False, True])
def test_torch_files_of_both_kinds(new: bool, tmp_path: Path) -> None:
    torch.save({"a": {"b": torch.eye(3)}}, tmp_path / "a.pt", _use_new_zipfile_serialization=new)
    np.testing.assert_array_equal(read_results(tmp_path / "a.pt")["a"]["b"], np.eye(3))


RECONSTRUCT, SCALAR = np.empty(0).__reduce__()[0], np.float64(0).__reduce__()[0]
EMPTY = (np.ndarray, (0,), b"b")
F8, OBJECT = np.dtype("f8"), np.dtype("O")


@pytest.mark.parametrize(
    "crafted",
    [
        Reduced(np.ndarray, ((5,),)),
        Reduced(RECONSTRUCT, EMPTY, (1, (5,), F8, False, b"\0" * 8)),
        Reduced(RECONSTRUCT, EMPTY, (1, (-1,), F8, False, b"\0" * 8)),
        Reduced(RECONSTRUCT, EMPTY, (1, (2**62, 4), F8, False, b"")),
        Reduced(RECONSTRUCT, EMPTY, (1, (1,), OBJECT, False, b"\x41" * 8)),
        Reduced(RECONSTRUCT, EMPTY, (1, (3,), OBJECT, False, [1])),
        Reduced(RECONSTRUCT, EMPTY, (1, "text", F8, False, b"")),
        Reduced(SCALAR, (OBJECT, b"\x41" * 8)),
        Reduced(SCALAR, (F8, b"\0")),
        Reduced(np.dtype, ("f8", False, True), (3, "|", None, ("a",), {"a": (F8, 0)}, 8, 1, 0)),
        Reduced(np.dtype, ([("a", "f8")],)),
        Reduced(OrderedDict, (), {"keys": 1}),
    ],
)
def test_crafted_arrays_are_refused(crafted: Reduced, tmp_path: Path) -> None:
    path = tmp_path / "a.pkl"
    path.write_bytes(pickle.dumps({"a": crafted, "b": [crafted]}))
    with pytest.raises(ValueError, match="refused, it cannot be read safely"):
        read_results(path)


def test_a_tensor_may_not_reach_beyond_its_numbers() -> None:
    whole = torch.arange(4.0)
    numbers = torch.storage.TypedStorage(
        wrap_storage=whole.untyped_storage(), dtype=whole.dtype, _internal=True
    )
    np.testing.assert_array_equal(unpickle.tensor(numbers, 1, (3,), (1,)), [1, 2, 3])
    for offset, size, stride in ((2, (3,), (1,)), (0, (2, 3), (3, 1)), (-1, (1,), (1,))):
        with pytest.raises(pickle.UnpicklingError, match="it contains a"):
            unpickle.tensor(numbers, offset, size, stride)

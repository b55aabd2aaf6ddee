"""Arrays are checked at the door: type, shape, and sizes that fields share."""

from types import GenericAlias
from typing import Annotated

import numpy as np
import numpy.typing as npt
import pytest
from pydantic import ValidationError

from imocap_core.artifacts.schemas import (
    Floats,
    Ints,
    RefineSync,
    Shape,
    Sync,
    SyncMap,
    Table,
    Value,
)
from imocap_core.artifacts.schemas.base import dtype_of


class Path2D(Value):
    frames: Annotated[Ints, Shape("T")]
    xy: Annotated[Floats, Shape("T", 2)]
    extra: Annotated[Floats, Shape("*", "*")]


def make(frames: object, xy: object, extra: object = ((0.0,),)) -> Path2D:
    return Path2D(frames=frames, xy=xy, extra=extra)


def test_arrays_get_their_type_and_keep_their_shape() -> None:
    made = make([1, 2], [[0, 1], [2, 3]], np.zeros((5, 0)))
    assert made.frames.dtype == np.int64
    assert made.xy.dtype == np.float64
    assert made.xy.shape == (2, 2)
    assert made.extra.shape == (5, 0)


@pytest.mark.parametrize(
    "array_type",
    [
        np.ndarray[tuple[int, ...], np.dtype[np.float32]],  # NumPy's NDArray before 2.5
        GenericAlias(npt.NDArray, (np.float32,)),  # what it is from there on
    ],
)
def test_a_dtype_is_read_from_either_form_of_annotation(array_type: object) -> None:
    assert dtype_of(array_type) == np.float32
    with pytest.raises(TypeError, match="names no dtype"):
        dtype_of(np.ndarray)


def test_an_array_is_not_copied_when_it_already_fits() -> None:
    xy = np.zeros((2, 2))
    assert np.shares_memory(make([1, 2], xy).xy, xy)


@pytest.mark.parametrize(
    ("frames", "xy", "said"),
    [
        ([1, 2], np.zeros((2, 3)), r"xy[\s\S]*expected an array of shape \(T, 2\), got \(2, 3\)"),
        ([1, 2], np.zeros(2), r"expected an array of shape \(T, 2\), got \(2,\)"),
        ([1, 2], np.zeros((3, 2)), "xy has T = 3, but frames has T = 2"),
        ([1.5, 2], np.zeros((2, 2)), "frames[\\s\\S]*expected an array of int64, got float64"),
        ([1, 2], [["a", "b"], ["c", "d"]], "expected an array of float64, got <U1"),
    ],
)
def test_what_does_not_fit_is_named(frames: object, xy: object, said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        make(frames, xy)


def test_values_do_not_change_and_know_no_other_fields() -> None:
    made = make([1], [[0.0, 0.0]])
    with pytest.raises(ValidationError, match="frozen"):
        made.frames = np.zeros(1)
    with pytest.raises(ValidationError, match="Extra inputs"):
        Path2D(frames=[1], xy=[[0.0, 0.0]], extra=[[0.0]], more=1)


def test_sync_refuses_maps_that_do_not_belong(sync: Sync) -> None:
    fields = {name: getattr(sync, name) for name in type(sync).model_fields}
    with pytest.raises(ValidationError, match="reference: expected one of"):
        Sync(**{**fields, "reference": "z"})
    with pytest.raises(ValidationError, match=r"maps: expected lengths \[3, 3\], got \[3, 2\]"):
        Sync(**{**fields, "lengths": [3, 3]})
    short = SyncMap(id="a", reference_frame=[0.0], confidence=[1.0])
    with pytest.raises(ValidationError, match="expected unique ids, got a twice"):
        Sync(**{**fields, "ids": ["a", "a"], "maps": [short, short]})


def test_a_table_is_rectangular() -> None:
    with pytest.raises(ValidationError, match="row 1 has 1 cells, expected 2"):
        Table(name="t", title="", columns=["a", "b_mm"], rows=[["x", 1.0], ["y"]])


def test_json_schema_says_what_the_arrays_are() -> None:
    schema = RefineSync.model_json_schema()
    theta = schema["$defs"]["VideoMotion"]["properties"]["theta"]
    assert theta["description"].startswith("float64 array of shape (T, 72)")

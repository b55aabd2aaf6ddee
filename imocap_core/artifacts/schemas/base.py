"""Values whose arrays are checked when they are made: type, shape, shared sizes; ids.

A field says its shape in symbols,

    xy_px: Annotated[Floats, Shape("T", "K", 2)]

and every field of one value must agree about `T` and `K`. Numbers are exact, a symbol is any size
(the same one throughout the value), "*" is any size at all. Missing numbers are NaN.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar, get_args

import numpy as np
import numpy.typing as npt
from pydantic import (
    BaseModel,
    ConfigDict,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    model_validator,
)
from pydantic_core import CoreSchema, core_schema

Floats = npt.NDArray[np.float64]
Floats32 = npt.NDArray[np.float32]
Ints = npt.NDArray[np.int64]
Ints16 = npt.NDArray[np.uint16]


def dtype_of(array_type: Any) -> np.dtype[Any]:
    """The dtype that an annotation names.

    NumPy's NDArray is an array's type before 2.5, and a name for one from there on.
    """
    if isinstance(array_type, type) and issubclass(array_type, np.generic):
        return np.dtype(array_type)
    for part in get_args(array_type):
        with suppress(TypeError):
            return dtype_of(part)
    raise TypeError(f"{array_type} names no dtype")


@dataclass(frozen=True, init=False)
class Shape:
    """The symbolic shape of an array field; the dtype is that of the annotated array type."""

    axes: tuple[int | str, ...]

    def __init__(self, *axes: int | str) -> None:
        object.__setattr__(self, "axes", axes)

    def __str__(self) -> str:
        inside = ", ".join(map(str, self.axes)) + ("," if len(self.axes) == 1 else "")
        return f"({inside})"

    def check(self, array: npt.NDArray) -> None:
        """ValueError unless `array` has as many axes as this shape, and the exact ones fit."""
        fits = array.ndim == len(self.axes) and all(
            isinstance(axis, str) or axis == size
            for axis, size in zip(self.axes, array.shape, strict=True)
        )
        if not fits:
            raise ValueError(f"expected an array of shape {self}, got {array.shape}")

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        dtype = dtype_of(source)

        def read(value: Any) -> npt.NDArray:
            array = np.asarray(value)
            if array.dtype.kind not in "biuf" or not np.can_cast(array.dtype, dtype, "same_kind"):
                raise ValueError(f"expected an array of {dtype}, got {array.dtype}")
            self.check(array)
            return np.ascontiguousarray(array, dtype=dtype).reshape(array.shape)

        return core_schema.no_info_plain_validator_function(
            read, metadata={"imocap_array": (dtype.name, str(self))}
        )

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        dtype, shape = schema["metadata"]["imocap_array"]  # type: ignore[typeddict-item]
        return {
            "type": "object",
            "description": f"{dtype} array of shape {shape}, stored as its own message",
            "properties": {"$array": {"type": "string"}},
            "required": ["$array"],
        }


class Value(BaseModel):
    """An immutable record, validated when it is made."""

    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True)
    OPTIONAL: ClassVar[frozenset[str]] = frozenset()  # fields that are not written when None

    @model_validator(mode="after")
    def _symbols_agree(self) -> Value:
        sizes: dict[str, tuple[int, str]] = {}
        faults = []
        for name, field in type(self).model_fields.items():
            shapes = [m for m in field.metadata if isinstance(m, Shape)]
            if not shapes:
                continue
            array = getattr(self, name)
            for axis, size in zip(shapes[0].axes, array.shape, strict=True):
                if not isinstance(axis, str) or axis == "*":
                    continue
                expected, first = sizes.setdefault(axis, (size, name))
                if expected != size:
                    faults.append(
                        f"{name} has {axis} = {size}, but {first} has {axis} = {expected}"
                    )
        if faults:
            raise ValueError("; ".join(faults))
        return self


class Artifact(Value):
    """A value that one stage makes and others read: the unit of the store."""


def unique(ids: list[str]) -> list[str]:
    """The ids themselves; ValueError when one appears twice."""
    repeated = sorted({i for i in ids if ids.count(i) > 1})
    if repeated:
        raise ValueError(f"expected unique ids, got {', '.join(repeated)} twice")
    return ids

"""The protobuf message `imocap.NdArray {name, dtype, shape, data}`, built without protoc."""

from __future__ import annotations

from typing import Any

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from jaxtyping import Shaped

NAME = "imocap.NdArray"


def _file_descriptor() -> descriptor_pb2.FileDescriptorProto:
    field = descriptor_pb2.FieldDescriptorProto
    file = descriptor_pb2.FileDescriptorProto(
        name="imocap/ndarray.proto", package="imocap", syntax="proto3"
    )
    message = file.message_type.add(name="NdArray")
    one, many = field.LABEL_OPTIONAL, field.LABEL_REPEATED
    message.field.add(name="name", number=1, type=field.TYPE_STRING, label=one)
    message.field.add(name="dtype", number=2, type=field.TYPE_STRING, label=one)
    message.field.add(name="shape", number=3, type=field.TYPE_INT64, label=many)
    message.field.add(name="data", number=4, type=field.TYPE_BYTES, label=one)
    return file


_FILE = _file_descriptor()
_POOL = descriptor_pool.DescriptorPool()
_POOL.Add(_FILE)
_NdArray: Any = message_factory.GetMessageClass(_POOL.FindMessageTypeByName(NAME))


def descriptor_set() -> bytes:
    """The schema as MCAP wants it: a serialized FileDescriptorSet."""
    return descriptor_pb2.FileDescriptorSet(file=[_FILE]).SerializeToString(deterministic=True)


def to_bytes(name: str, array: Shaped[np.ndarray, "..."]) -> bytes:
    """One array as a message; little endian, C order."""
    little = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
    message = _NdArray(
        name=name, dtype=little.dtype.name, shape=array.shape, data=little.tobytes(order="C")
    )
    return message.SerializeToString(deterministic=True)


def from_bytes(data: bytes) -> tuple[str, Shaped[np.ndarray, "..."]]:
    """Name and array (writable) of a message. ValueError when its parts don't fit each other."""
    message = _NdArray.FromString(data)
    dtype = np.dtype(message.dtype).newbyteorder("<")
    array = np.frombuffer(message.data, dtype=dtype).reshape(tuple(message.shape))
    return message.name, array.astype(dtype.newbyteorder("="), copy=True)

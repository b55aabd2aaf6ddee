"""Artifacts as MCAP files: one JSON header, one protobuf message an array, side files attached.

What a result says of how it was made: a recipe as JSON texts, checked where it is read. An artifact
may come from somebody else; whoever reads its recipe relies on these forms.

The content digest is taken over the decoded messages, never over the file: compressed bytes differ
between releases of zstandard. Everything in the file is covered by a checksum, and every way in
which reading can fail is one error, ArtifactCorrupt, whose cure is to compute the artifact again.
"""

from __future__ import annotations

import hashlib
import json
import math
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TypeVar

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import DecodeError
from jaxtyping import Shaped
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Chunk, DataEnd, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, Writer
from pydantic import BaseModel, TypeAdapter, ValidationError
from zstandard import ZstdError, frame_content_size

from imocap_core import limits
from imocap_core.artifacts.side_files import check_names
from imocap_core.errors import CONTROL, ArtifactCorrupt

if TYPE_CHECKING:
    from imocap_core.artifacts.schemas.base import Artifact


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


FORMS: dict[str, TypeAdapter[Any]] = {
    "code": TypeAdapter(dict[str, str]),
    "params": TypeAdapter(dict[str, dict[str, Any]]),
    "seed": TypeAdapter(int),
    "inputs": TypeAdapter(dict[str, str]),
    "reads": TypeAdapter(dict[str, str]),
    "format": TypeAdapter(int),
}


def _check_provenance(provenance: Mapping[str, str]) -> None:
    """ArtifactCorrupt when a part of the recipe is not of its form; parts may be missing."""
    for name, form in FORMS.items():
        try:
            if name in provenance:
                form.validate_json(provenance[name], strict=True)
        except ValidationError:
            raise ArtifactCorrupt(f"its provenance has no usable {name}") from None


LIBRARY = "imocap artifact 1"  # fixed, so that equal artifacts give equal files
LOG_TIME = 0
HEADER, PROVENANCE = "/header", "imocap.provenance"
SCHEMA_PREFIX = "imocap."
REFERENCE = "$array"
ZSTD = "zstd"  # in the records
FOOTER = struct.Struct("<BQQQI8s")  # opcode, length, summary start, its offsets, CRC, magic
READER_ERRORS = (
    McapError,
    ZstdError,
    DecodeError,
    struct.error,
    ArithmeticError,
    LookupError,
    MemoryError,
    OSError,
    TypeError,
    ValueError,
)

Kind = TypeVar("Kind", bound="Artifact")


@dataclass(frozen=True)
class Content:
    """The content of a file, decoded and checked by its checksums, not yet validated."""

    schema: str  # the artifact's class
    header: bytes  # canonical JSON; arrays are {"$array": name}
    arrays: dict[str, Shaped[np.ndarray, "..."]]
    provenance: dict[str, str] = field(default_factory=dict)  # how it was made; not content
    files: dict[str, bytes] = field(default_factory=dict)  # side files; not content

    @cached_property
    def digest(self) -> str:
        """SHA-256 of schema, header and arrays."""
        sha = hashlib.sha256()
        for part in (self.schema.encode(), self.header):
            sha.update(struct.pack("<Q", len(part)))
            sha.update(part)
        for name in sorted(self.arrays):
            array = self.arrays[name]
            sha.update(f"{name}\0{array.dtype.name}\0{array.shape}\0".encode())
            sha.update(np.ascontiguousarray(array).data)
        return sha.hexdigest()


def pack(artifact: Artifact) -> Content:
    """Split an artifact into its header and its arrays (named by their path in the header)."""
    arrays: dict[str, Shaped[np.ndarray, "..."]] = {}
    header = _without_arrays(artifact, "", arrays)
    text = json.dumps(header, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return Content(type(artifact).__name__, text.encode(), arrays)


def unpack(content: Content, kind: type[Kind]) -> Kind:
    """The artifact, validated by its schema. ArtifactCorrupt when it does not fit `kind`."""
    if content.schema != kind.__name__:
        raise ArtifactCorrupt(f"expected a {kind.__name__}, got a {content.schema}")
    try:
        data = _with_arrays(json.loads(content.header), content.arrays)
        return kind.model_validate(data)
    except (ValidationError, LookupError, TypeError, ValueError, RecursionError) as error:
        raise ArtifactCorrupt(f"does not fit the schema {kind.__name__}: {error}") from error


def write(stream: BinaryIO, content: Content, json_schema: Mapping[str, Any]) -> None:
    """Write a file that any MCAP reader can list: it includes the header's JSON schema."""
    writer = Writer(stream, compression=CompressionType.ZSTD, enable_data_crcs=True)
    writer.start(profile="", library=LIBRARY)
    schema_text = json.dumps(json_schema, sort_keys=True).encode()
    header_schema = writer.register_schema(
        name=SCHEMA_PREFIX + content.schema, encoding="jsonschema", data=schema_text
    )
    files = descriptor_pb2.FileDescriptorSet(file=[_FILE]).SerializeToString(deterministic=True)
    array_schema = writer.register_schema(name=NAME, encoding="protobuf", data=files)
    messages = [(HEADER, "json", header_schema, content.header)]
    messages += [
        ("/" + name, "protobuf", array_schema, to_bytes(name, content.arrays[name]))
        for name in sorted(content.arrays)
    ]
    for topic, encoding, schema, data in messages:
        channel = writer.register_channel(topic=topic, message_encoding=encoding, schema_id=schema)
        writer.add_message(channel, log_time=LOG_TIME, publish_time=LOG_TIME, data=data)
    for name in sorted(content.files):
        writer.add_attachment(
            LOG_TIME, LOG_TIME, name, "application/octet-stream", content.files[name]
        )
    writer.add_metadata(PROVENANCE, dict(sorted(content.provenance.items())))
    writer.finish()


def read(file: Path) -> Content:
    """Read a file and check every byte of it. ArtifactCorrupt for any fault."""
    try:
        data = file.read_bytes()
        # the summary's CRC, which the MCAP reader leaves to its callers
        footer = data[-FOOTER.size :]
        _, _, start, _, expected, _ = FOOTER.unpack(footer)
        if zlib.crc32(footer[:25], zlib.crc32(data[start : -FOOTER.size])) != expected:
            raise ArtifactCorrupt("the summary does not match its checksum")
        return _collect(data)
    except ArtifactCorrupt as error:
        raise ArtifactCorrupt(f"{file}: {error}") from None
    except READER_ERRORS as error:
        raise ArtifactCorrupt(f"{file}: {type(error).__name__}: {error}") from error


def _records(data: bytes) -> Iterator[McapRecord]:
    """All records, those of chunks among them. What chunks say that they unpack to is added up, and
    ArtifactCorrupt comes before any is unpacked that is too much."""
    most, unpacked = max(limits.MAX_UNPACKED_BYTES, limits.MAX_INFLATION * len(data)), 0
    for record in StreamReader(BytesIO(data), emit_chunks=True, validate_crcs=True).records:
        if not isinstance(record, Chunk):
            yield record
            continue
        if record.compression != ZSTD:
            raise ArtifactCorrupt(f"a chunk is compressed by {record.compression!r}, not {ZSTD}")
        unpacked += max(record.uncompressed_size, frame_content_size(record.data))
        if unpacked > most:
            raise ArtifactCorrupt(f"its {len(data):,} bytes would unpack to {unpacked:,} or more")
        yield from breakup_chunk(record, validate_crc=True)


def _collect(data: bytes) -> Content:
    """One pass over the records up to the end of the data section, whose CRC must be there."""
    schemas: dict[int, str] = {}
    topics: dict[int, tuple[str, int]] = {}
    header, kind = b"", ""
    arrays: dict[str, Shaped[np.ndarray, "..."]] = {}
    provenance: dict[str, str] = {}
    attached: list[Attachment] = []
    whole = False
    for record in _records(data):
        if whole:
            continue  # the summary repeats schemas and channels
        if isinstance(record, Schema):
            schemas[record.id] = record.name
        elif isinstance(record, Channel):
            topics[record.id] = (record.topic, record.schema_id)
        elif isinstance(record, Message) and topics[record.channel_id][0] == HEADER:
            header = record.data
            kind = schemas[topics[record.channel_id][1]].removeprefix(SCHEMA_PREFIX)
        elif isinstance(record, Message):
            name, array = from_bytes(record.data)
            arrays[name] = array
        elif isinstance(record, Attachment):
            attached.append(record)
        elif isinstance(record, Metadata):
            provenance = record.metadata
        elif isinstance(record, DataEnd):
            whole = record.data_section_crc != 0
    if not whole or not header:
        raise ArtifactCorrupt("ends before its data section does")
    check_names(record.name for record in attached)
    _check_provenance(provenance)
    files = {record.name: record.data for record in attached}
    return Content(kind, header, arrays, provenance, files)


def _without_arrays(value: Any, path: str, arrays: dict[str, Shaped[np.ndarray, "..."]]) -> Any:
    """JSON of a value; arrays move to `arrays` and leave {"$array": path} behind."""
    if isinstance(value, np.ndarray):
        assert path not in arrays, f"two arrays are named {path}"
        arrays[path] = value
        return {REFERENCE: path}
    if isinstance(value, BaseModel):
        optional: frozenset[str] = getattr(value, "OPTIONAL", frozenset())
        fields = {name: getattr(value, name) for name in type(value).model_fields}
        value = {k: v for k, v in fields.items() if v is not None or k not in optional}
    inside = f"{path}/" if path else ""
    if isinstance(value, dict):
        return {k: _without_arrays(v, f"{inside}{k}", arrays) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_without_arrays(v, f"{inside}{i}", arrays) for i, v in enumerate(value)]
    if isinstance(value, float) and not math.isfinite(value):
        return {math.inf: "Infinity", -math.inf: "-Infinity"}.get(value, "NaN")
    return value


def _with_arrays(value: Any, arrays: Mapping[str, Shaped[np.ndarray, "..."]]) -> Any:
    """The inverse of `_without_arrays`, up to what the schema's types say."""
    if isinstance(value, dict):
        if value.keys() == {REFERENCE}:
            return arrays[value[REFERENCE]]
        return {k: _with_arrays(v, arrays) for k, v in value.items()}
    if isinstance(value, list):
        return [_with_arrays(v, arrays) for v in value]
    if isinstance(value, str) and CONTROL.search(value):
        raise ValueError(f"a text with control characters: {value!r:.80}")
    return value

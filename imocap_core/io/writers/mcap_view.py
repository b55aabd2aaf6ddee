"""Protobuf messages as an MCAP file that Foxglove and Rerun open; the file contains its schemas."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from google.protobuf import descriptor_pool
from google.protobuf.descriptor import FileDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet
from google.protobuf.message import Message
from mcap.writer import CompressionType, Writer

LIBRARY = "imocap view 1"  # fixed, without version and date: equal content gives equal bytes
METADATA = "imocap"


@dataclass(frozen=True, order=True)
class Entry:
    """One serialized message: its time, topic and schema (`foxglove.Pose`)."""

    time_ns: int
    topic: str
    schema: str
    data: bytes


def entry(time_ns: int, topic: str, message: Message) -> Entry:
    """A message, serialized."""
    data = message.SerializeToString(deterministic=True)
    return Entry(time_ns, topic, message.DESCRIPTOR.full_name, data)


def write_view(file: Path, entries: Iterable[Entry], notes: Mapping[str, str]) -> None:
    """Write entries in the order of time; `notes` become the file's metadata."""
    with file.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD, enable_data_crcs=True)
        writer.start(profile="", library=LIBRARY)
        writer.add_metadata(METADATA, dict(notes))
        channels: dict[tuple[str, str], int] = {}
        schemas: dict[str, int] = {}
        for one in sorted(entries):
            if one.schema not in schemas:
                schemas[one.schema] = writer.register_schema(
                    name=one.schema, encoding="protobuf", data=schema_bytes(one.schema)
                )
            key = (one.topic, one.schema)
            if key not in channels:
                channels[key] = writer.register_channel(
                    topic=one.topic, message_encoding="protobuf", schema_id=schemas[one.schema]
                )
            writer.add_message(
                channels[key], log_time=one.time_ns, publish_time=one.time_ns, data=one.data
            )
        writer.finish()


def schema_bytes(schema: str) -> bytes:
    """A message's schema as MCAP stores it: a serialized FileDescriptorSet, imports first."""
    message = descriptor_pool.Default().FindMessageTypeByName(schema)
    files: dict[str, FileDescriptorProto] = {}
    _add_with_imports(message.file, files)
    return FileDescriptorSet(file=files.values()).SerializeToString(deterministic=True)


def _add_with_imports(file: FileDescriptor, files: dict[str, FileDescriptorProto]) -> None:
    if file.name not in files:
        for imported in file.dependencies:
            _add_with_imports(imported, files)
        files[file.name] = FileDescriptorProto.FromString(file.serialized_pb)

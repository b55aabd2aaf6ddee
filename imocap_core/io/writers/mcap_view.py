"""Messages as an MCAP file that Foxglove and Rerun open: protobuf, its schemas within."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, Writer

from imocap_core.io.writers.foxglove_schemas import descriptor_set

LIBRARY = "imocap view 1"  # fixed: a file says what it holds, not who wrote it when
METADATA = "imocap"


@dataclass(frozen=True, order=True)
class Entry:
    """One message, already in bytes: when, on which topic, of which schema (`foxglove.Pose`)."""

    time_ns: int
    topic: str
    schema: str
    data: bytes


def entry(time_ns: int, topic: str, message: Any) -> Entry:
    """A message as it will lie in the file."""
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
                    name=one.schema, encoding="protobuf", data=descriptor_set()
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

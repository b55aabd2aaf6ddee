"""Foxglove's message schemas, as far as a view file uses them, built without protoc.

Names, numbers and types of the fields are those of the public schemas (package `foxglove`), so that
programs that know these read the files; every message that one of ours can hold is here too, as
programs look into them.
"""

from __future__ import annotations

import re
from functools import cache
from typing import Any

from google.protobuf import (
    descriptor_pb2,
    descriptor_pool,
    duration_pb2,
    message_factory,
    timestamp_pb2,
)

PACKAGE = "foxglove"
# message: field=number type, ... a type ends in [] when repeated; {A B}: an enumeration's names
SCHEMAS = """
Vector3: x=1 double, y=2 double, z=3 double
Point2: x=1 double, y=2 double
Point3: x=1 double, y=2 double, z=3 double
Quaternion: x=1 double, y=2 double, z=3 double, w=4 double
Color: r=1 double, g=2 double, b=3 double, a=4 double
KeyValuePair: key=1 string, value=2 string
Pose: position=1 Vector3, orientation=2 Quaternion
PosesInFrame: timestamp=1 Timestamp, frame_id=2 string, poses=3 Pose[]
FrameTransform: timestamp=1 Timestamp, parent_frame_id=2 string, child_frame_id=3 string, \
translation=4 Vector3, rotation=5 Quaternion
CameraCalibration: timestamp=1 Timestamp, frame_id=9 string, width=2 fixed32, height=3 fixed32, \
distortion_model=4 string, D=5 double[], K=6 double[], R=7 double[], P=8 double[]
CompressedImage: timestamp=1 Timestamp, frame_id=4 string, data=2 bytes, format=3 string
CircleAnnotation: timestamp=1 Timestamp, position=2 Point2, diameter=3 double, thickness=4 double, \
fill_color=5 Color, outline_color=6 Color, metadata=7 KeyValuePair[]
PointsAnnotation: timestamp=1 Timestamp, type=2 {UNKNOWN POINTS LINE_LOOP LINE_STRIP LINE_LIST}, \
points=3 Point2[], outline_color=4 Color, outline_colors=5 Color[], fill_color=6 Color, \
thickness=7 double, metadata=8 KeyValuePair[]
TextAnnotation: timestamp=1 Timestamp, position=2 Point2, text=3 string, font_size=4 double, \
text_color=5 Color, background_color=6 Color, metadata=7 KeyValuePair[]
ImageAnnotations: circles=1 CircleAnnotation[], points=2 PointsAnnotation[], \
texts=3 TextAnnotation[], metadata=4 KeyValuePair[], timestamp=5 Timestamp
ArrowPrimitive: pose=1 Pose, shaft_length=2 double, shaft_diameter=3 double, \
head_length=4 double, head_diameter=5 double, color=6 Color
CubePrimitive: pose=1 Pose, size=2 Vector3, color=3 Color
SpherePrimitive: pose=1 Pose, size=2 Vector3, color=3 Color
CylinderPrimitive: pose=1 Pose, size=2 Vector3, bottom_scale=3 double, top_scale=4 double, \
color=5 Color
LinePrimitive: type=1 {LINE_STRIP LINE_LOOP LINE_LIST}, pose=2 Pose, thickness=3 double, \
scale_invariant=4 bool, points=5 Point3[], color=6 Color, colors=7 Color[], indices=8 fixed32[]
TriangleListPrimitive: pose=1 Pose, points=2 Point3[], color=3 Color, colors=4 Color[], \
indices=5 fixed32[]
TextPrimitive: pose=1 Pose, billboard=2 bool, font_size=3 double, scale_invariant=4 bool, \
color=5 Color, text=6 string
ModelPrimitive: pose=1 Pose, scale=2 Vector3, color=3 Color, override_color=4 bool, url=5 string, \
media_type=6 string, data=7 bytes
SceneEntityDeletion: timestamp=1 Timestamp, type=2 {MATCHING_ID ALL}, id=3 string
SceneEntity: timestamp=1 Timestamp, frame_id=2 string, id=3 string, lifetime=4 Duration, \
frame_locked=5 bool, metadata=6 KeyValuePair[], arrows=7 ArrowPrimitive[], \
cubes=8 CubePrimitive[], spheres=9 SpherePrimitive[], cylinders=10 CylinderPrimitive[], \
lines=11 LinePrimitive[], triangles=12 TriangleListPrimitive[], texts=13 TextPrimitive[], \
models=14 ModelPrimitive[]
SceneUpdate: deletions=1 SceneEntityDeletion[], entities=2 SceneEntity[]
"""
FIELD = re.compile(r"(\w+)=(\d+) (\w+|\{[^}]*\})(\[\])?")
_Field = descriptor_pb2.FieldDescriptorProto
SCALARS = {
    "double": _Field.TYPE_DOUBLE,
    "string": _Field.TYPE_STRING,
    "bool": _Field.TYPE_BOOL,
    "bytes": _Field.TYPE_BYTES,
    "fixed32": _Field.TYPE_FIXED32,
}
GOOGLE = {"Timestamp": timestamp_pb2, "Duration": duration_pb2}


@cache
def message_class(name: str) -> Any:
    """The class of a message of the package, by its short name."""
    return message_factory.GetMessageClass(_pool().FindMessageTypeByName(f"{PACKAGE}.{name}"))


@cache
def descriptor_set() -> bytes:
    """The schemas as MCAP wants them: a serialized FileDescriptorSet, what they import first."""
    files = [_google(module) for module in GOOGLE.values()]
    whole = descriptor_pb2.FileDescriptorSet(file=[*files, _file()])
    return whole.SerializeToString(deterministic=True)


@cache
def _pool() -> descriptor_pool.DescriptorPool:
    pool = descriptor_pool.DescriptorPool()
    for file in (*(_google(module) for module in GOOGLE.values()), _file()):
        pool.Add(file)
    return pool


def _google(module: Any) -> descriptor_pb2.FileDescriptorProto:
    return descriptor_pb2.FileDescriptorProto.FromString(module.DESCRIPTOR.serialized_pb)


def _file() -> descriptor_pb2.FileDescriptorProto:
    file = descriptor_pb2.FileDescriptorProto(
        name="foxglove/view.proto", package=PACKAGE, syntax="proto3"
    )
    file.dependency.extend(module.DESCRIPTOR.name for module in GOOGLE.values())
    for line in SCHEMAS.strip().splitlines():
        name, fields = line.split(": ", 1)
        message = file.message_type.add(name=name)
        for field, number, kind, many in FIELD.findall(fields):
            label = _Field.LABEL_REPEATED if many else _Field.LABEL_OPTIONAL
            made = message.field.add(name=field, number=int(number), label=label)
            _typed(made, kind, message)
    return file


def _typed(field: Any, kind: str, message: descriptor_pb2.DescriptorProto) -> None:
    if kind in SCALARS:
        field.type = SCALARS[kind]
    elif kind.startswith("{"):
        field.type, field.type_name = _Field.TYPE_ENUM, f".{PACKAGE}.{message.name}.Type"
        names = message.enum_type.add(name="Type")
        for number, name in enumerate(kind[1:-1].split()):
            names.value.add(name=name, number=number)
    else:
        package = "google.protobuf" if kind in GOOGLE else PACKAGE
        field.type, field.type_name = _Field.TYPE_MESSAGE, f".{package}.{kind}"

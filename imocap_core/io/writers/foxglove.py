"""View files for Foxglove and Rerun: messages of cameras, pictures, keypoints, bodies as MCAP.

Coordinate frames: `world`, and `<id>_camera` of each video (x right, y down, z forward). Times are
nanoseconds. The message classes are those of the package `foxglove-schemas-protobuf`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Point2_pb2 import Point2
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.PointsAnnotation_pb2 import PointsAnnotation
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf import descriptor_pool
from google.protobuf.descriptor import FileDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet
from google.protobuf.message import Message
from google.protobuf.timestamp_pb2 import Timestamp
from jaxtyping import Float
from mcap.writer import CompressionType, Writer
from scipy.spatial.transform import Rotation

Colour = tuple[float, float, float]  # sRGB, 0 to 1

WORLD = "world"
BONE_PX, POINT_PX = 3.0, 4.0
SECOND = 1_000_000_000  # nanoseconds


def _camera_frame(video: str) -> str:
    """Name of a video's camera frame."""
    return f"{video}_camera"


def transform(
    time_ns: int,
    video: str,
    R_cam_from_world: Float[np.ndarray, "3 3"],
    centre: Float[np.ndarray, "3"],
) -> FrameTransform:
    """Pose of a video's camera in the world; centre in metres."""
    return FrameTransform(
        timestamp=_stamp(time_ns),
        parent_frame_id=WORLD,
        child_frame_id=_camera_frame(video),
        translation=_vector(centre),
        rotation=_quaternion(R_cam_from_world.T),
    )


def calibration(
    time_ns: int,
    video: str,
    K: Float[np.ndarray, "3 3"],
    size: tuple[int, int],
    distortion: Float[np.ndarray, " 5"],
) -> CameraCalibration:
    """Intrinsics of pictures of `size` (width, height); distortion: OpenCV's, of K."""
    P = np.concatenate([K, np.zeros((3, 1))], axis=1)
    return CameraCalibration(
        timestamp=_stamp(time_ns),
        frame_id=_camera_frame(video),
        width=size[0],
        height=size[1],
        distortion_model="plumb_bob",
        D=distortion.tolist(),
        K=K.ravel().tolist(),
        R=np.eye(3).ravel().tolist(),
        P=P.ravel().tolist(),
    )


def image(time_ns: int, video: str, jpeg: bytes) -> CompressedImage:
    """The JPEG picture of one frame."""
    return CompressedImage(
        timestamp=_stamp(time_ns), frame_id=_camera_frame(video), data=jpeg, format="jpeg"
    )


def keypoints(time_ns: int, xy_px: Float[np.ndarray, "K 2"], colour: Colour) -> ImageAnnotations:
    """Keypoints drawn as dots over the picture; NaN ones are left out."""
    detected = xy_px[np.isfinite(xy_px).all(-1)]
    points = PointsAnnotation(
        timestamp=_stamp(time_ns),
        type=PointsAnnotation.POINTS,
        points=[Point2(x=float(x), y=float(y)) for x, y in detected],
        outline_color=_colour(colour),
        fill_color=_colour(colour),
        thickness=POINT_PX,
    )
    return ImageAnnotations(timestamp=_stamp(time_ns), points=[points])


def joints(
    time_ns: int, positions_m: Float[np.ndarray, "J 3"], R_world: Float[np.ndarray, "J 3 3"]
) -> PosesInFrame:
    """Positions and axes of all joints in the world, in the order of the motion clip."""
    return PosesInFrame(
        timestamp=_stamp(time_ns),
        frame_id=WORLD,
        poses=[
            Pose(position=_vector(x), orientation=_quaternion(R))
            for x, R in zip(positions_m, R_world, strict=True)
        ],
    )


def skeleton(
    time_ns: int,
    video: str,
    positions_m: Float[np.ndarray, "J 3"],
    parents: tuple[int, ...],
    colour: Colour,
) -> SceneUpdate:
    """The bones as lines; each message replaces the one before."""
    ends = [positions_m[k] for j, parent in enumerate(parents) if parent >= 0 for k in (parent, j)]
    lines = LinePrimitive(
        type=LinePrimitive.LINE_LIST,
        pose=Pose(position=_vector(np.zeros(3)), orientation=_quaternion(np.eye(3))),
        thickness=BONE_PX,
        scale_invariant=True,
        points=[Point3(x=float(x), y=float(y), z=float(z)) for x, y, z in ends],
        color=_colour(colour),
    )
    entity = SceneEntity(timestamp=_stamp(time_ns), frame_id=WORLD, id=video, lines=[lines])
    return SceneUpdate(entities=[entity])


def _stamp(time_ns: int) -> Timestamp:
    return Timestamp(seconds=time_ns // SECOND, nanos=time_ns % SECOND)


def _vector(xyz: Float[np.ndarray, "3"]) -> Vector3:
    x, y, z = map(float, xyz)
    return Vector3(x=x, y=y, z=z)


def _quaternion(R: Float[np.ndarray, "3 3"]) -> Quaternion:
    x, y, z, w = Rotation.from_matrix(R).as_quat().tolist()
    return Quaternion(x=x, y=y, z=z, w=w)


def _colour(rgb: Colour) -> Color:
    return Color(r=rgb[0], g=rgb[1], b=rgb[2], a=1.0)


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
                    name=one.schema, encoding="protobuf", data=_schema_bytes(one.schema)
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


def _schema_bytes(schema: str) -> bytes:
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

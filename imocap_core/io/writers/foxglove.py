"""Messages of a view file, in Foxglove's schemas: cameras, their pictures, keypoints, bodies.

Frames: `world`, and `<id>_camera` of each video (x right, y down, z ahead). Times are nanoseconds.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from imocap_core.io.writers.foxglove_schemas import message_class

Array = NDArray[np.float64]
Colour = tuple[float, float, float]  # as on screens, 0 to 1

WORLD = "world"
BONE_PX, POINT_PX = 3.0, 4.0
SECOND = 1_000_000_000


def camera_frame(video: str) -> str:
    """The name of a video's camera axes."""
    return f"{video}_camera"


def transform(time_ns: int, video: str, R_cam_from_world: Array, centre: Array) -> Any:
    """FrameTransform: where the camera of a video is in the world."""
    return message_class("FrameTransform")(
        timestamp=_stamp(time_ns),
        parent_frame_id=WORLD,
        child_frame_id=camera_frame(video),
        translation=_point("Vector3", centre),
        rotation=_quaternion(R_cam_from_world.T),
    )


def calibration(time_ns: int, video: str, K: Array, size: tuple[int, int]) -> Any:
    """CameraCalibration of pictures of `size` (width, height), without distortion."""
    P = np.concatenate([K, np.zeros((3, 1))], axis=1)
    return message_class("CameraCalibration")(
        timestamp=_stamp(time_ns),
        frame_id=camera_frame(video),
        width=size[0],
        height=size[1],
        distortion_model="plumb_bob",
        D=[0.0] * 5,
        K=K.ravel().tolist(),
        R=np.eye(3).ravel().tolist(),
        P=P.ravel().tolist(),
    )


def image(time_ns: int, video: str, jpeg: bytes) -> Any:
    """CompressedImage of one frame."""
    return message_class("CompressedImage")(
        timestamp=_stamp(time_ns), frame_id=camera_frame(video), data=jpeg, format="jpeg"
    )


def keypoints(time_ns: int, xy_px: Array, colour: Colour) -> Any:
    """ImageAnnotations: points (K, 2) of the picture; NaN ones are left out."""
    seen = xy_px[np.isfinite(xy_px).all(-1)]
    points = message_class("PointsAnnotation")(
        timestamp=_stamp(time_ns),
        type=1,
        points=[_point("Point2", xy) for xy in seen],
        outline_color=_colour(colour),
        fill_color=_colour(colour),
        thickness=POINT_PX,
    )
    return message_class("ImageAnnotations")(timestamp=_stamp(time_ns), points=[points])


def joints(time_ns: int, places: Array, R_world: Array) -> Any:
    """PosesInFrame: joints (J, 3) metres and their axes (J, 3, 3), in the clip's order."""
    Pose = message_class("Pose")
    return message_class("PosesInFrame")(
        timestamp=_stamp(time_ns),
        frame_id=WORLD,
        poses=[
            Pose(position=_point("Vector3", x), orientation=_quaternion(R))
            for x, R in zip(places, R_world, strict=True)
        ],
    )


def skeleton(
    time_ns: int, video: str, places: Array, parents: tuple[int, ...], colour: Colour
) -> Any:
    """SceneUpdate: the bones as lines; each message replaces the one before."""
    ends = [places[k] for j, parent in enumerate(parents) if parent >= 0 for k in (parent, j)]
    lines = message_class("LinePrimitive")(
        type=2,
        pose=message_class("Pose")(
            position=_point("Vector3", np.zeros(3)), orientation=_quaternion(np.eye(3))
        ),
        thickness=BONE_PX,
        scale_invariant=True,
        points=[_point("Point3", x) for x in ends],
        color=_colour(colour),
    )
    entity = message_class("SceneEntity")(
        timestamp=_stamp(time_ns), frame_id=WORLD, id=video, lines=[lines]
    )
    return message_class("SceneUpdate")(entities=[entity])


def _stamp(time_ns: int) -> dict[str, int]:
    return {"seconds": time_ns // SECOND, "nanos": time_ns % SECOND}


def _point(kind: str, values: Array) -> Any:
    return message_class(kind)(**dict(zip("xyz", map(float, values), strict=False)))


def _quaternion(R: Array) -> Any:
    return message_class("Quaternion")(**dict(zip("xyzw", _xyzw(R), strict=True)))


def _xyzw(R: Array) -> list[float]:
    found: list[float] = Rotation.from_matrix(R).as_quat().tolist()
    return found


def _colour(rgb: Colour) -> Any:
    return message_class("Color")(r=rgb[0], g=rgb[1], b=rgb[2], a=1.0)

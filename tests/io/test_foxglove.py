"""View files: read back by the schemas in the file alone, and by Rerun where it is installed."""

import os
import subprocess
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader
from scipy.spatial.transform import Rotation

from imocap_core.io.writers import foxglove
from imocap_core.io.writers.foxglove import entry, write_view

K = np.array([[500.0, 0, 240], [0, 510, 135], [0, 0, 1]])
R = Rotation.from_rotvec([0.2, -0.4, 2.5]).as_matrix()
DISTORTION = np.array([-0.2, 0.05, 0.0, 0.0, 0.01])
CENTRE = np.array([1.0, 2.0, 3.0])
PLACES = np.array([[0.0, 0, 1], [0, 0.1, 1.5], [0.2, 0.1, 1.4]])
TIMES = (0, 33_333_333, 2_500_000_000)
RERUN = os.environ.get("IMOCAP_RERUN")
RED = (1.0, 0.0, 0.0)


def write(file: Path) -> None:
    """Three moments of one video."""
    entries = []
    for time in reversed(TIMES):  # the file puts them in order
        made = {
            "camera/transform": foxglove.transform(time, "v1", R, CENTRE),
            "camera/calibration": foxglove.calibration(time, "v1", K, (480, 270), DISTORTION),
            "camera/image": foxglove.image(time, "v1", b"\xff\xd8 a picture"),
            "camera/keypoints": foxglove.keypoints(
                time, np.array([[3.0, 4.0], [np.nan, 1.0], [5.0, 6.0]]), RED
            ),
            "joints": foxglove.joints(time, PLACES, np.tile(R, (3, 1, 1))),
            "skeleton": foxglove.skeleton(time, "v1", PLACES, (-1, 0, 1), RED),
        }
        entries += [entry(time, f"/v1/{topic}", message) for topic, message in made.items()]
    write_view(file, entries, {"up_axis": "z"})


def read(file: Path) -> tuple[dict[str, list[Any]], list[int]]:
    """Messages by topic and the log times, decoded by the schemas in the file."""
    messages: dict[str, list[Any]] = defaultdict(list)
    times = []
    with file.open("rb") as stream:
        for schema, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            pool = descriptor_pool.DescriptorPool()
            for proto in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
                pool.Add(proto)
            kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
            messages[channel.topic].append(kind.FromString(message.data))
            times.append(message.log_time)
    return messages, times


def test_messages_come_back_in_order(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap")
    messages, times = read(tmp_path / "a.mcap")
    assert times == sorted(times)
    assert {topic: len(of_topic) for topic, of_topic in messages.items()} == {
        f"/v1/{name}": 3
        for name in (
            *("camera/transform", "camera/calibration", "camera/image", "camera/keypoints"),
            *("joints", "skeleton"),
        )
    }
    stamps = [m.timestamp.seconds * 10**9 + m.timestamp.nanos for m in messages["/v1/joints"]]
    assert tuple(stamps) == TIMES
    with (tmp_path / "a.mcap").open("rb") as stream:
        notes = {m.name: m.metadata for m in make_reader(stream).iter_metadata()}
    assert notes == {"imocap": {"up_axis": "z"}}


def test_a_joint_is_seen_where_our_camera_sees_it(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap")
    messages, _ = read(tmp_path / "a.mcap")
    where, lens = messages["/v1/camera/transform"][0], messages["/v1/camera/calibration"][0]
    assert (where.parent_frame_id, where.child_frame_id) == ("world", "v1_camera")
    assert lens.frame_id == messages["/v1/camera/image"][0].frame_id == "v1_camera"
    q, t = where.rotation, where.translation
    R_world_from_cam = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
    pose = messages["/v1/joints"][0].poses[2]
    point = np.array([pose.position.x, pose.position.y, pose.position.z])
    np.testing.assert_allclose(point, PLACES[2])
    x = np.reshape(lens.K, (3, 3)) @ R_world_from_cam.T @ (point - [t.x, t.y, t.z])
    expected = K @ R @ (PLACES[2] - CENTRE)
    np.testing.assert_allclose(x, expected, atol=1e-9)
    np.testing.assert_allclose(np.reshape(lens.P, (3, 4))[:, :3], K)
    turned = Rotation.from_quat(
        [pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w]
    )
    np.testing.assert_allclose(turned.as_matrix(), R, atol=1e-12)


def test_keypoints_that_are_missing_are_left_out_and_bones_are_pairs(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap")
    messages, _ = read(tmp_path / "a.mcap")
    (points,) = messages["/v1/camera/keypoints"][0].points
    assert [(p.x, p.y) for p in points.points] == [(3, 4), (5, 6)]
    (entity,) = messages["/v1/skeleton"][1].entities
    ends = [(p.x, p.y, p.z) for p in entity.lines[0].points]
    np.testing.assert_allclose(ends, PLACES[[0, 1, 1, 2]])
    assert (entity.id, entity.frame_id) == ("v1", "world")


def test_the_same_messages_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write(tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


@pytest.mark.skipif(RERUN is None, reason="IMOCAP_RERUN names no rerun command")
def test_rerun_takes_cameras_pictures_and_joints(tmp_path: Path) -> None:
    write(tmp_path / "a.mcap")
    for words in (
        ["mcap", "convert", tmp_path / "a.mcap", "-o", tmp_path / "a.rrd"],
        ["rrd", "stats", tmp_path / "a.rrd"],
    ):
        run = subprocess.run(
            [str(RERUN), *map(str, words)], capture_output=True, text=True, check=True
        )
    for component in (
        *("Pinhole:image_from_camera", "EncodedImage:blob", "Transform3D:translation"),
        *("InstancePoses3D:translations", "CoordinateFrame:frame"),
    ):
        assert component in run.stdout, component
    assert "/v1/joints" in run.stdout

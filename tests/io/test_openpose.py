"""OpenPose folders: read as written, refused with a sentence when malformed."""

import json

import numpy as np
import pytest

from imocap_core.io.readers.openpose import read_openpose


def write(folder, number, people):
    folder.mkdir(exist_ok=True)
    content = {"version": 1.3, "people": [{"pose_keypoints_2d": values} for values in people]}
    file = folder / f"clip_{number:012d}_keypoints.json"
    file.write_text(json.dumps(content))
    return file


def body(points=25, x=10.0):
    return [value for k in range(points) for value in (x + k, 20.0 + k, 0.5)]


def test_frames_people_and_points_keep_their_places(tmp_path):
    write(tmp_path, 3, [body(), body(x=200.0)])
    write(tmp_path, 5, [])
    detected = read_openpose(tmp_path, "body25")
    assert detected.frames.tolist() == [3, 5]
    assert [len(people) for people in detected.people] == [2, 0]
    assert detected.people[0][1, 4].tolist() == [204.0, 24.0, 0.5]


def test_a_point_without_confidence_is_missing(tmp_path):
    values = body()
    values[6:9] = [0, 0, 0]
    write(tmp_path, 0, [values])
    person = read_openpose(tmp_path, "body25").people[0][0]
    assert np.isnan(person[2, :2]).all()
    assert person[2, 2] == 0


def test_a_person_with_only_hands_is_no_body(tmp_path):
    write(tmp_path, 0, [[], body()])
    assert len(read_openpose(tmp_path, "body25").people[0]) == 1


@pytest.mark.parametrize(("layout", "points"), [("body25", 25), ("body25b", 25), ("coco18", 18)])
def test_layouts(tmp_path, layout, points):
    write(tmp_path, 0, [body(points)])
    assert read_openpose(tmp_path, layout).people[0].shape == (1, points, 3)


def test_a_wrong_layout_is_named_with_the_right_one(tmp_path):
    file = write(tmp_path, 0, [body(18)])
    with pytest.raises(ValueError, match="got 54; set layout: coco18") as error:
        read_openpose(tmp_path, "body25")
    assert str(file) in str(error.value)
    with pytest.raises(ValueError, match="got 'h36m17'"):
        read_openpose(tmp_path, "h36m17")


def test_broken_files_are_all_named_at_once(tmp_path):
    write(tmp_path, 0, [body()])
    (tmp_path / "clip_1_keypoints.json").write_text('{"people": [')
    (tmp_path / "clip_2_keypoints.json").write_text('{"persons": []}')
    (tmp_path / "clip_3_keypoints.json").write_text('{"people": [{"pose_keypoints_2d": ["a"]}]}')
    write(tmp_path, 4, [["x"] * 75])
    with pytest.raises(ValueError, match="is not JSON") as error:
        read_openpose(tmp_path, "body25")
    lines = str(error.value).splitlines()
    assert len(lines) == 4
    assert "people: expected a list of people, got nothing" in lines[1]
    assert "people[0].pose_keypoints_2d: expected 75 numbers" in lines[2]
    assert "expected numbers only" in lines[3]


def test_folders_without_frames_are_refused(tmp_path):
    with pytest.raises(ValueError, match="expected a folder"):
        read_openpose(tmp_path / "none", "body25")
    with pytest.raises(ValueError, match=r"found no \.json file"):
        read_openpose(tmp_path, "body25")
    (tmp_path / "clip.json").write_text("{}")
    with pytest.raises(ValueError, match="expected a frame number"):
        read_openpose(tmp_path, "body25")


def test_two_files_of_one_frame_are_refused(tmp_path):
    write(tmp_path, 7, [])
    (tmp_path / "other_7.json").write_text("{}")
    with pytest.raises(ValueError, match="frame 7 has two files"):
        read_openpose(tmp_path, "body25")

"""Every reader of 2D keypoints gives back what was written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from imocap_core.io.readers.keypoint_readers import FORMATS, format_and_layout
from tests.io import made_keypoints as made
from tests.io.detector_cases import CASES, read, written


@pytest.mark.parametrize("case", CASES)
def test_what_was_written_is_read(case: str, tmp_path: Path) -> None:
    path, people, kind, layout = written(case, tmp_path)
    detected = read(path, kind, layout)
    assert detected.frames.tolist() == list(people)
    for frame, here in zip(detected.frames, detected.people, strict=True):
        expected = np.stack(people[int(frame)])
        if kind == "cpn_npz":  # it knows no confidence
            expected[..., 2] = np.where(np.isfinite(expected[..., 0]), 1.0, 0.0)
        np.testing.assert_allclose(here, expected, atol=1e-9)


@pytest.mark.parametrize("case", CASES)
def test_format_and_layout_are_told_by_the_files(case: str, tmp_path: Path) -> None:
    path, _, kind, layout = written(case, tmp_path)
    if layout.startswith("body25"):
        layout = "body25"  # points at random fit neither: asked for, see test_guess
        with pytest.raises(ValueError, match="fit both"):
            format_and_layout(path, None, None)
        assert format_and_layout(path, None, layout) == (kind, layout)
    else:
        assert format_and_layout(path, None, None) == (kind, layout)
        assert format_and_layout(path, kind, None) == (kind, layout)
    assert kind in FORMATS


def test_hands_and_faces_of_openpose_do_not_disturb(tmp_path: Path) -> None:
    people = made.people("body25b")
    path = made.write_openpose(tmp_path, people, hands=True)
    detected = read(path, "openpose", "body25b")
    np.testing.assert_allclose(detected.people[1], np.stack(people[1]))


def test_scores_of_heat_maps_count_as_one_at_most(tmp_path: Path) -> None:
    people = made.people("coco17", persons=1)
    people[0][0][0, 2] = 3.7
    detected = read(made.write_alphapose(tmp_path, people), "alphapose", "coco17")
    assert detected.people[0][0, 0, 2] == 1.0


def test_frames_without_anybody_stay(tmp_path: Path) -> None:
    people = made.people("coco17")
    people[1] = []
    for write, kind in ((made.write_mmpose, "mmpose"), (made.write_deeplabcut, "deeplabcut")):
        detected = read(write(tmp_path, people), kind, "coco17")
        assert [len(here) for here in detected.people] == [2, 0, 2]


def test_mmpose_lists_that_count_from_one_begin_with_frame_zero(tmp_path: Path) -> None:
    path = made.write_mmpose(tmp_path, {2: made.people("coco17")[0]})
    assert read(path, "mmpose", "coco17").frames.tolist() == [3]  # a list with gaps is believed


def test_mediapipe_in_pixels_and_as_npz(tmp_path: Path) -> None:
    people = made.people("mediapipe33", persons=1)
    path = made.write_mediapipe(tmp_path, people, shares=False)
    np.testing.assert_allclose(read(path, "mediapipe", "mediapipe33").people[2][0], people[2][0])
    table = np.array([[*p.T[:2], 0 * p[:, 0], p[:, 2]] for (p, *_) in people.values()])
    path = tmp_path / "landmarks.npz"
    np.savez(path, pose_landmarks=np.swapaxes(np.nan_to_num(table), 1, 2))
    assert format_and_layout(path, None, None) == ("mediapipe", "mediapipe33")
    np.testing.assert_allclose(read(path, "mediapipe", "mediapipe33").people[2][0], people[2][0])


def test_mediapipe_of_several_people_as_npz(tmp_path: Path) -> None:
    people = made.people("mediapipe33", persons=2)
    table = np.full((len(people), 3, 33, 4), np.nan)
    for row, in_frame in zip(table, people.values(), strict=True):
        for p, person in enumerate(in_frame):
            row[p + 1] = np.column_stack([person[:, :2], 0 * person[:, 0], person[:, 2]])
    path = tmp_path / "landmarks.npz"
    np.savez(path, pose_landmarks=table)
    read_people = read(path, "mediapipe", "mediapipe33").people[2]
    assert len(read_people) == 2
    for got, person in zip(read_people, people[2], strict=True):
        np.testing.assert_allclose(got, person)


def test_names_of_layouts_are_formats_of_any_file(tmp_path: Path) -> None:
    path = made.write_npz(tmp_path, made.people("halpe26"))
    assert format_and_layout(path, "halpe26", None) == ("npz", "halpe26")
    path = made.write_coco_wholebody(tmp_path, made.people("wholebody133"))
    assert format_and_layout(path, "wholebody", "wholebody133") == ("coco", "wholebody133")


def test_videopose3d_clips_are_chosen_by_the_videos_name(tmp_path: Path) -> None:
    tables = [np.full((2, 17, 2), float(n), np.float32) for n in range(4)]
    tree = {
        "S9": {"Walking 1": tables[:2], "Eating": tables[2:3]},
        "clip.mp4": {"custom": tables[3:]},
    }
    path = made.write_positions(tmp_path, tree, "coco")
    assert read(path, "cpn_npz", "coco17", "S9_Walking_1_1").people[0][0, 0, 0] == 1.0
    assert read(path, "cpn_npz", "coco17", "v1", "clip.mp4").people[0][0, 0, 0] == 3.0
    with pytest.raises(
        ValueError, match=r"named like the video's id \(v1\), got 4: S9 Walking 1 0"
    ):
        read(path, "cpn_npz", "coco17", "v1")


def test_body_parts_may_be_written_in_many_ways(tmp_path: Path) -> None:
    people = made.people("coco17", persons=1)
    path = made.write_sleap(tmp_path, people)
    text = path.read_text()
    for old, new in (
        ("left-knee", "LKnee"), ("right-knee", "knee_R"), ("left-hip", "Left Hip"),
        ("right-hip", "right_hip"), ("left-wrist", "leftwrist"), ("nose", "Nose"),
    ):  # fmt: skip
        text = text.replace(old, new)
    path.write_text(text)
    np.testing.assert_allclose(read(path, "sleap", "coco17").people[0][0], people[0][0])
    path.write_text(path.read_text().replace("-", "x"))
    detected = read(path, "sleap", "body25")  # the neck is not in the file
    assert np.isnan(detected.people[0][0, 1]).any()
    path.write_text("track,frame_idx,instance.score,snout.x,snout.y\n,0,1,2,3\n")
    with pytest.raises(ValueError, match="at least 4 body parts named like coco17's"):
        read(path, "sleap", "coco17")

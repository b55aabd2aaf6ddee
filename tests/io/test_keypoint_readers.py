"""Every reader of 2D keypoints gives back what was written; malformed files are refused in a
sentence."""

import json
import pickle
from pathlib import Path

import numpy as np
import pytest
import torch

from imocap_core.body import load_free_body
from imocap_core.io.readers.json_people import read_openpose, read_openpose_hands
from imocap_core.io.readers.keypoint_readers import FORMATS, format_and_layout, guess_detections
from imocap_core.io.readers.people import points
from tests.io import made_keypoints as made
from tests.io.detector_cases import CASES, FILES, read, refused, written
from tests.reduced import touching


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
    for write, kind in ((made.write_mmpose, "mmpose"), (made.write_ultralytics, "ultralytics")):
        detected = read(write(tmp_path, people), kind, "coco17")
        assert [len(here) for here in detected.people] == [2, 0, 2]
    detected = read(made.write_openpose(tmp_path, {3: people[0], 5: []}), "openpose", "coco17")
    assert detected.frames.tolist() == [3, 5]
    assert [len(here) for here in detected.people] == [2, 0]


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
    path = made.write_named_csv(tmp_path, people)
    text = path.read_text()
    for old, new in (
        ("left_knee", "L-Knee"), ("right_knee", "knee_R"), ("left_hip", "Left Hip"),
        ("right_hip", "right-hip"), ("left_wrist", "leftwrist"), ("nose", "Nose"),
    ):  # fmt: skip
        text = text.replace(old, new)
    path.write_text(text)
    assert format_and_layout(path, None, None) == ("npz", "coco17")
    np.testing.assert_allclose(read(path, "npz", "coco17").people[0][0], people[0][0])


EACH = pytest.mark.parametrize("case", FILES)


@EACH
@pytest.mark.parametrize("share", [0.0, 0.6])
def test_a_truncated_file_is_refused(case: str, share: float, tmp_path: Path) -> None:
    path, _, kind, layout = written(case, tmp_path)
    content = path.read_bytes()
    end = int(share * len(content))
    if path.suffix == ".csv":  # in the middle of a row
        end = content.rfind(b";" if "semicolons" in case else b",", 0, end) + 1
    path.write_bytes(content[:end])
    refused(path, kind, layout)


@EACH
@pytest.mark.parametrize("content", ["7", "{}", '[{"image_id": "a"}]', "[[]]"])
def test_a_file_of_something_else_is_refused(case: str, content: str, tmp_path: Path) -> None:
    path, _, kind, layout = written(case, tmp_path)
    path.write_text(content)
    refused(path, kind, layout)
    with pytest.raises(ValueError, match=path.name):
        format_and_layout(path, None, None)


@pytest.mark.parametrize("case", [n for n in FILES if "csv" not in n])
def test_a_file_with_another_number_of_points_is_refused(case: str, tmp_path: Path) -> None:
    write, kind, layout = CASES[case]
    people = {
        f: [p[:-1] for p in in_frame] for f, in_frame in made.people(layout, persons=1).items()
    }
    message = refused(write(tmp_path, people), kind, layout)
    assert "expected" in message


@EACH
def test_a_missing_file_is_refused(case: str, tmp_path: Path) -> None:
    path, _, kind, layout = written(case, tmp_path)
    path.unlink()
    assert "no such file" in refused(path, kind, layout)


@EACH
def test_nobody_in_the_whole_file_is_refused(case: str, tmp_path: Path) -> None:
    write, kind, layout = CASES[case]
    unseen = {f: [np.full_like(p, np.nan) * [1, 1, 0] for p in in_frame]
              for f, in_frame in made.people(layout, persons=1).items()}  # fmt: skip
    for in_frame in unseen.values():
        in_frame[0][:, 2] = 0.0
    path = write(tmp_path, unseen)
    kinds = ("alphapose", "coco", "mmpose", "ultralytics", "mediapipe", "openpose")
    if kind in kinds and path.suffix != ".csv":
        assert all(np.isnan(p[..., 0]).all() for p in read(path, kind, layout).people)
    else:
        assert "at least one person" in refused(path, kind, layout)


@EACH
@pytest.mark.parametrize("layout", ["smpl24", "hands42"])
def test_a_layout_that_the_format_has_not_is_refused(case, layout, tmp_path):
    path, _, kind, _ = written(case, tmp_path)
    refused(path, kind, layout)


def test_a_wrong_layout_is_named_with_the_right_one(tmp_path: Path) -> None:
    path = made.write_alphapose(tmp_path, made.people("halpe26"))
    with pytest.raises(ValueError, match=r"expected 51 numbers .* got 78 numbers; set layout: hal"):
        read(path, "alphapose", "coco17")
    path = made.write_npz(tmp_path, made.people("wholebody133"))
    with pytest.raises(ValueError, match=r"26 points of halpe26, got 133; set layout: wholebody"):
        read(path, "npz", "halpe26")
    with pytest.raises(ValueError, match=r"someone: expected \(17, 3\) .* got \(\)"):
        points(7.0, "coco17", "someone")


def test_wrong_entries_are_named(tmp_path: Path) -> None:
    path = made.write_coco(tmp_path, made.people("coco17"))
    entries = json.loads(path.read_text())
    for field, value, message in (
        ("keypoints", ["a"] * 51, r"\[2\].keypoints: expected numbers only"),
        ("keypoints", None, r"\[2\].keypoints: expected a list of numbers, got nothing"),
        *(
            ("image_id", x, r"\[2\].image_id: expected a frame number")
            for x in ("a", -1, 10**40, True)
        ),
    ):
        changed = [dict(entry) for entry in entries]
        changed[2][field] = value
        path.write_text(json.dumps(changed))
        with pytest.raises(ValueError, match=message):
            read(path, "coco", "coco17")


@pytest.mark.parametrize("array", ["positions_2d", "metadata"])
def test_a_pickle_in_an_npz_runs_nothing(array: str, tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    path = tmp_path / "evil.npz"
    arrays = {name: np.array({}, dtype=object) for name in ("positions_2d", "metadata")}
    arrays[array] = np.array({"S1": touching(victim)}, dtype=object)
    np.savez(path, **arrays)
    layouts = {"metadata": None, "positions_2d": "h36m17"}[array]
    with pytest.raises(ValueError, match="refused, it can't be read safely"):
        read(path, *format_and_layout(path, "cpn_npz", layouts))
    assert not victim.exists()
    pickle.loads(pickle.dumps(touching(victim)))
    assert victim.exists()  # it would have


def _write(folder: Path, people: list[np.ndarray]) -> Path:
    return made.write_openpose(folder, {n: [p] if len(p) else [] for n, p in enumerate(people)})


@pytest.mark.parametrize("layout", ["body25", "body25b"])
def test_the_two_layouts_of_25_points_are_told_apart(layout: str, tmp_path: Path) -> None:
    # a standing body seen from all sides
    model = load_free_body()
    points = model.points(layout)
    posed = model.shape(torch.zeros(10, dtype=torch.float64)).pose(
        torch.eye(3, dtype=torch.float64).expand(24, 3, 3), torch.zeros(3, dtype=torch.float64)
    )
    xyz = posed.keypoints(points).numpy()
    rng = np.random.default_rng(0)
    people = []
    for angle in np.linspace(0, 3, 8):
        x = 200 * (np.cos(angle) * xyz[:, 0] + np.sin(angle) * xyz[:, 2]) + 500
        person = np.zeros((25, 3))
        xy = np.column_stack([x, 400 - 200 * xyz[:, 1]]) + rng.normal(size=(len(xyz), 2))
        person[list(points.columns or range(25))] = np.column_stack([xy, np.full(len(xy), 0.9)])
        people.append(person)
    folder = _write(tmp_path, [np.zeros((0, 3)), *people])
    assert guess_detections(folder) == ("openpose", layout)


def test_the_number_of_points_tells_coco(tmp_path: Path) -> None:
    assert guess_detections(_write(tmp_path, [np.ones((18, 3))])) == ("openpose", "coco18")


@pytest.mark.parametrize(
    ("people", "message"),
    [
        (
            [np.ones((25, 3))],
            "fit both about equally; say which with `format` and `layout` in action.yaml",
        ),
        ([np.ones((16, 3))], "18 \\(coco18\\), 25 \\(body25 or body25b\\), 26 \\(halpe26\\)"),
        ([np.ones((18, 3)), np.ones((25, 3))], "got 18, 25; keep one detector's output"),
        ([np.zeros((0, 3))], "nobody was detected"),
    ],
)
def test_what_is_not_clear_is_asked_for(people, message, tmp_path):
    folder = _write(tmp_path, people)
    with pytest.raises(ValueError, match=message):
        guess_detections(folder)


def test_files_that_are_something_else(tmp_path: Path) -> None:
    (tmp_path / "odd").mkdir()
    (tmp_path / "odd" / "f0.json").write_text("[1, 2]")
    with pytest.raises(ValueError, match="expected OpenPose's JSON"):
        guess_detections(tmp_path / "odd")
    results = tmp_path / "results.json"
    results.write_text(json.dumps([{"image_id": "1.jpg", "keypoints": [], "box": []}]))
    with pytest.raises(ValueError, match="alphapose, but the file does not tell the layout"):
        guess_detections(results)
    assert guess_detections(results, layout="halpe26") == ("alphapose", "halpe26")


def write(folder, number, people):
    folder.mkdir(exist_ok=True)
    content = {"version": 1.3, "people": [{"pose_keypoints_2d": values} for values in people]}
    file = folder / f"clip_{number:012d}_keypoints.json"
    file.write_text(json.dumps(content))
    return file


def body(points=25, x=10.0):
    return [value for k in range(points) for value in (x + k, 20.0 + k, 0.5)]


def test_a_person_with_only_hands_is_no_body(tmp_path):
    write(tmp_path, 0, [[], body()])
    assert len(read_openpose(tmp_path, "body25").people[0]) == 1


def test_broken_files_are_all_named_at_once(tmp_path):
    write(tmp_path, 0, [body()])
    (tmp_path / "clip_1_keypoints.json").write_text('{"people": [')
    (tmp_path / "clip_2_keypoints.json").write_text('{"persons": []}')
    (tmp_path / "clip_3_keypoints.json").write_text('{"people": [{"pose_keypoints_2d": [0.5]}]}')
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


BODY = np.column_stack([np.arange(25) * 3.0, np.arange(25) * 5.0])
FRAMES = np.array([4, 5, 6])


def person(shift: float, left: list[float] | None, right: list[float] | None) -> dict:
    rows = np.column_stack([BODY + shift, np.ones(25)])
    made: dict = {"pose_keypoints_2d": rows.ravel().tolist()}
    if left is not None:
        made["hand_left_keypoints_2d"] = left
    if right is not None:
        made["hand_right_keypoints_2d"] = right
    return made


def hand(value: float) -> list[float]:
    return np.column_stack([np.full((21, 2), value), np.full(21, 0.5)]).ravel().tolist()


def write_hands(folder: Path, frame: int, people: list[dict]) -> None:
    (folder / f"v_{frame:012d}_keypoints.json").write_text(json.dumps({"people": people}))


def test_the_hands_of_this_very_person(tmp_path: Path) -> None:
    write_hands(tmp_path, 4, [person(90, hand(1), hand(2)), person(0, hand(3), None)])
    write_hands(tmp_path, 6, [person(0, [], hand(5)), person(90, hand(1), hand(2))])
    hands = read_openpose_hands(tmp_path, FRAMES, np.stack([BODY] * 3))
    xy, confidence = hands
    assert (xy[0, 0] == 3).all()
    assert (xy[2, 1] == 5).all()
    assert np.isnan(xy[0, 1]).all()
    assert np.isnan(xy[1]).all()
    assert (confidence > 0).sum() == 42


def test_without_hands_there_are_none(tmp_path: Path) -> None:
    write_hands(tmp_path, 4, [person(0, None, [])])
    assert read_openpose_hands(tmp_path, FRAMES, np.stack([BODY] * 3)) is None


def test_a_hand_of_another_length_is_named(tmp_path: Path) -> None:
    write_hands(tmp_path, 4, [person(0, hand(1)[:60], None)])
    with pytest.raises(ValueError, match=r"hand_left_keypoints_2d: expected 63 numbers.*got 60"):
        read_openpose_hands(tmp_path, FRAMES, np.stack([BODY] * 3))

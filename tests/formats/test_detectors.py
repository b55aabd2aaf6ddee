"""Every reader of 2D keypoints: gives back what was written, refuses what is malformed."""

from __future__ import annotations

import json
import pickle
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imocap_core.formats.detectors import FORMATS, format_and_layout, read_detections
from tests.formats import made_keypoints as made

Write = Callable[[Path, made.People], Path]
CASES: dict[str, tuple[Write, str, str]] = {  # name: writer, format, layout
    "openpose": (made.write_openpose, "openpose", "body25"),
    "openpose body25b": (made.write_openpose, "openpose", "body25b"),
    "openpose coco18": (made.write_openpose, "openpose", "coco18"),
    "openpose halpe26": (made.write_openpose, "openpose", "halpe26"),
    "alphapose": (made.write_alphapose, "alphapose", "coco17"),
    "alphapose 26": (made.write_alphapose, "alphapose", "halpe26"),
    "alphapose 136": (made.write_alphapose, "alphapose", "halpe136"),
    "coco": (made.write_coco, "coco", "coco17"),
    "coco wholebody": (made.write_coco_wholebody, "coco", "wholebody133"),
    "coco 133": (made.write_coco, "coco", "wholebody133"),
    "mmpose": (made.write_mmpose, "mmpose", "coco17"),
    "mmpose inferencer": (made.write_mmpose_inferencer, "mmpose", "halpe26"),
    "npz": (made.write_npz, "npz", "halpe26"),
    "npz 133": (made.write_npz, "npz", "wholebody133"),
    "mediapipe": (made.write_mediapipe, "mediapipe", "mediapipe33"),
    "cpn_npz": (made.write_cpn_npz, "cpn_npz", "h36m17"),
    "deeplabcut": (made.write_deeplabcut, "deeplabcut", "coco17"),
    "sleap": (made.write_sleap, "sleap", "coco17"),
}
ALL = pytest.mark.parametrize("case", CASES)
FILES = pytest.mark.parametrize("case", [name for name in CASES if "openpose" not in name])


def read(path: Path, kind: str, layout: str, *names: str) -> Any:
    return read_detections(path, kind, layout, size=made.SIZE, names=names or ("v1",))


def written(case: str, folder: Path, **changes: Any) -> tuple[Path, made.People, str, str]:
    write, kind, layout = CASES[case]
    one = {"persons": 1} if kind == "cpn_npz" else {}
    people = made.people(layout, **(one | changes))
    return write(folder, people), people, kind, layout


@ALL
def test_what_was_written_is_read(case: str, tmp_path: Path) -> None:
    path, people, kind, layout = written(case, tmp_path)
    found = read(path, kind, layout)
    assert found.frames.tolist() == list(people)
    for frame, here in zip(found.frames, found.people, strict=True):
        expected = np.stack(people[int(frame)])
        if kind == "cpn_npz":  # it knows no confidence
            expected[..., 2] = np.where(np.isfinite(expected[..., 0]), 1.0, 0.0)
        np.testing.assert_allclose(here, expected, atol=1e-9)


@ALL
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


@FILES
@pytest.mark.parametrize("share", [0.0, 0.3, 0.7])
def test_a_truncated_file_is_refused(case: str, share: float, tmp_path: Path) -> None:
    path, _, kind, layout = written(case, tmp_path)
    content = path.read_bytes()
    end = int(share * len(content))
    if path.suffix == ".csv":  # in the middle of a row
        end = content.rfind(b",", 0, end) + 1
    path.write_bytes(content[:end])
    refused(path, kind, layout)


@FILES
@pytest.mark.parametrize("content", ["7", '"text"', "[1, 2]", "{}", '[{"image_id": "a"}]', "[[]]"])
def test_a_file_of_something_else_is_refused(case: str, content: str, tmp_path: Path) -> None:
    path, _, kind, layout = written(case, tmp_path)
    path.write_text(content)
    refused(path, kind, layout)
    with pytest.raises(ValueError, match=path.name):
        format_and_layout(path, None, None)


@FILES
def test_a_file_with_another_number_of_points_is_refused(case: str, tmp_path: Path) -> None:
    write, kind, layout = CASES[case]
    if kind in ("deeplabcut", "sleap"):
        pytest.skip("named points may be any number")
    people = {f: [p[:-1] for p in found] for f, found in made.people(layout, persons=1).items()}
    said = refused(write(tmp_path, people), kind, layout)
    assert "expected" in said


@FILES
def test_a_missing_file_is_refused(case: str, tmp_path: Path) -> None:
    path, _, kind, layout = written(case, tmp_path)
    path.unlink()
    assert "no such file" in refused(path, kind, layout)


@FILES
def test_nobody_in_the_whole_file_is_refused(case: str, tmp_path: Path) -> None:
    write, kind, layout = CASES[case]
    unseen = {f: [np.full_like(p, np.nan) * [1, 1, 0] for p in found]
              for f, found in made.people(layout, persons=1).items()}  # fmt: skip
    for found in unseen.values():
        found[0][:, 2] = 0.0
    path = write(tmp_path, unseen)
    if kind in ("alphapose", "coco", "mmpose", "mediapipe", "sleap"):
        assert all(np.isnan(p[..., 0]).all() for p in read(path, kind, layout).people)
    else:
        assert "at least one person" in refused(path, kind, layout)


@FILES
@pytest.mark.parametrize("layout", ["smpl24", "hands42"])
def test_a_layout_that_the_format_has_not_is_refused(
    case: str, layout: str, tmp_path: Path
) -> None:
    path, _, kind, _ = written(case, tmp_path)
    refused(path, kind, layout)


def refused(path: Path, kind: str, layout: str) -> str:
    with pytest.raises(ValueError, match=r".") as said:
        read(path, kind, layout)
    assert str(path) in str(said.value)
    assert "\n" not in str(said.value)
    return str(said.value)


def test_a_wrong_layout_is_named_with_the_right_one(tmp_path: Path) -> None:
    path = made.write_alphapose(tmp_path, made.people("halpe26"))
    with pytest.raises(ValueError, match=r"expected 51 numbers .* got 78 numbers; set layout: hal"):
        read(path, "alphapose", "coco17")
    path = made.write_npz(tmp_path, made.people("wholebody133"))
    with pytest.raises(ValueError, match=r"26 points of halpe26, got 133; set layout: wholebody"):
        read(path, "npz", "halpe26")


def test_wrong_entries_are_named(tmp_path: Path) -> None:
    path = made.write_coco(tmp_path, made.people("coco17"))
    entries = json.loads(path.read_text())
    for field, value, said in (
        ("keypoints", ["a"] * 51, r"\[2\].keypoints: expected numbers only"),
        ("keypoints", None, r"\[2\].keypoints: expected a list of numbers, got nothing"),
        ("image_id", "no number", r"\[2\].image_id: expected a frame number"),
        ("image_id", -1, r"\[2\].image_id: expected a frame number"),
        ("image_id", 10**40, r"\[2\].image_id: expected a frame number"),
        ("image_id", True, r"\[2\].image_id: expected a frame number"),
    ):
        changed = [dict(entry) for entry in entries]
        changed[2][field] = value
        path.write_text(json.dumps(changed))
        with pytest.raises(ValueError, match=said):
            read(path, "coco", "coco17")


def test_hands_and_faces_of_openpose_do_not_disturb(tmp_path: Path) -> None:
    people = made.people("body25b")
    path = made.write_openpose(tmp_path, people, hands=True)
    found = read(path, "openpose", "body25b")
    np.testing.assert_allclose(found.people[1], np.stack(people[1]))


def test_scores_of_heat_maps_count_as_one_at_most(tmp_path: Path) -> None:
    people = made.people("coco17", persons=1)
    people[0][0][0, 2] = 3.7
    found = read(made.write_alphapose(tmp_path, people), "alphapose", "coco17")
    assert found.people[0][0, 0, 2] == 1.0


def test_frames_without_anybody_stay(tmp_path: Path) -> None:
    people = made.people("coco17")
    people[1] = []
    for write, kind in ((made.write_mmpose, "mmpose"), (made.write_deeplabcut, "deeplabcut")):
        found = read(write(tmp_path, people), kind, "coco17")
        assert [len(here) for here in found.people] == [2, 0, 2]


def test_mmpose_lists_that_count_from_one_begin_with_frame_zero(tmp_path: Path) -> None:
    path = made.write_mmpose(tmp_path, {2: made.people("coco17")[0]})
    assert read(path, "mmpose", "coco17").frames.tolist() == [3]  # a list with gaps is believed


def test_mediapipe_in_pixels_and_as_npz(tmp_path: Path) -> None:
    people = made.people("mediapipe33", persons=1)
    path = made.write_mediapipe(tmp_path, people, shares=False)
    np.testing.assert_allclose(read(path, "mediapipe", "mediapipe33").people[2][0], people[2][0])
    table = np.array(
        [[*found[0].T[:2], 0 * found[0][:, 0], found[0][:, 2]] for found in people.values()]
    )
    path = tmp_path / "landmarks.npz"
    np.savez(path, pose_landmarks=np.swapaxes(np.nan_to_num(table), 1, 2))
    assert format_and_layout(path, None, None) == ("mediapipe", "mediapipe33")
    np.testing.assert_allclose(read(path, "mediapipe", "mediapipe33").people[2][0], people[2][0])


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
        ValueError, match=r"called like the video's id \(v1\), got 4: S9 Walking 1 0"
    ):
        read(path, "cpn_npz", "coco17", "v1")


class Evil:
    """Makes a file when it is unpickled."""

    def __init__(self, victim: Path) -> None:
        self.victim = victim

    def __reduce__(self) -> tuple[Any, ...]:
        return (Path.touch, (self.victim,))


def evil_npz(folder: Path, array: str, victim: Path) -> Path:
    path = folder / "evil.npz"
    arrays = {name: np.array({}, dtype=object) for name in ("positions_2d", "metadata")}
    arrays[array] = np.array({"S1": Evil(victim)}, dtype=object)
    np.savez(path, **arrays)
    return path


@pytest.mark.parametrize("array", ["positions_2d", "metadata"])
def test_a_pickle_in_an_npz_runs_nothing(array: str, tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    path = evil_npz(tmp_path, array, victim)
    told = {"metadata": None, "positions_2d": "h36m17"}[array]
    with pytest.raises(ValueError, match="refused, it can't be read safely"):
        read(path, *format_and_layout(path, "cpn_npz", told))
    assert not victim.exists()
    pickle.loads(pickle.dumps(Evil(victim)))
    assert victim.exists()  # it would have


def test_hdf5_is_refused_with_what_to_do(tmp_path: Path) -> None:
    path = tmp_path / "clip.h5"
    path.write_bytes(b"\x89HDF\r\n")
    for kind in ("deeplabcut", "sleap"):
        assert "export the results as CSV" in refused(path, kind, "coco17")


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
    found = read(path, "sleap", "body25")  # the neck is not in the file
    assert np.isnan(found.people[0][0, 1]).any()
    path.write_text("track,frame_idx,instance.score,snout.x,snout.y\n,0,1,2,3\n")
    with pytest.raises(ValueError, match="at least 4 body parts named like coco17's"):
        read(path, "sleap", "coco17")


@FILES
def test_damaged_files_are_read_or_refused_but_never_fail(case: str, tmp_path: Path) -> None:
    """A few bytes changed, wherever."""
    path, _, kind, layout = written(case, tmp_path)
    whole, rng = path.read_bytes(), random.Random(0)
    for _ in range(25):
        damaged = bytearray(whole)
        for _ in range(rng.randint(1, 4)):
            damaged[rng.randrange(len(damaged))] = rng.randrange(256)
        path.write_bytes(bytes(damaged))
        for attempt in (read, format_and_layout):
            try:
                attempt(path, kind, layout if attempt is read else None)
            except ValueError as error:
                assert str(path) in str(error)  # noqa: PT017

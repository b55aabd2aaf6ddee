"""The .h5 files of DeepLabCut and SLEAP: read as their CSV, or refused; nothing in them runs, and
nothing beside them is opened. Files made by the tools' own libraries where these are installed."""

import json
import os
import pickle
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imocap_core.body.layouts import layout_names
from imocap_core.io import array_files
from imocap_core.io.readers.keypoint_readers import format_and_layout
from tests.io import made_keypoints as made
from tests.io.detector_cases import read, refused
from tests.reduced import touching

KINDS = pytest.mark.parametrize("kind", ["deeplabcut", "sleap"])
LAYOUT = "coco17"
COORDS = ("x", "y", "likelihood")


@pytest.fixture
def h5py() -> Any:
    return pytest.importorskip("h5py", reason="h5py, the extra h5, is not installed")


def write_deeplabcut(h5py: Any, folder: Path, people: made.People, **changes: Any) -> Path:
    """As pandas' `to_hdf(..., format="table")` lays out the frame of DeepLabCut's analysis."""
    path, count = folder / "clipDLC_resnet50.h5", max(map(len, people.values()))
    columns = [("DLC", f"p{i}", part, c) for i in range(count)
               for part in layout_names(LAYOUT) for c in COORDS]  # fmt: skip
    values = np.full((len(people), len(columns)), np.nan)
    for row, persons in zip(values, people.values(), strict=True):
        numbers = np.concatenate([person.ravel() for person in persons])
        row[: len(numbers)] = numbers
    rows = np.zeros(len(people), [("index", "<i8"), ("values_block_0", "<f8", (len(columns),))])
    rows["index"], rows["values_block_0"] = list(people), values
    names = ["scorer", "individuals", "bodyparts", "coords"]
    attributes = {"values_block_0_kind": columns, "info": {1: {"names": names}, "index": {}}}
    with h5py.File(path, "w") as root:
        group = root.create_group("df_with_missing")
        group.attrs["pandas_type"] = np.bytes_(b"frame_table")
        table = group.create_dataset("table", data=rows)
        for name, content in (attributes | changes).items():
            place = group if name == "info" else table
            place.attrs[name] = np.bytes_(pickle.dumps(content, 0))
    return path


def write_sleap(h5py: Any, folder: Path, people: made.People, dims: bool = True) -> Path:
    """SLEAP's analysis file, with the order of axes that SLEAP has; dims: as sleap-io says it."""
    path, count = folder / "clip.analysis.h5", max(map(len, people.values()))
    table = np.full((max(people) + 1, count, 17, 3), np.nan)
    for frame, persons in people.items():
        table[frame, : len(persons)] = persons
    with h5py.File(path, "w") as root:
        root["tracks"] = table[..., :2].transpose(1, 3, 2, 0)
        root["point_scores"] = table[..., 2].transpose(1, 2, 0)
        root["node_names"] = [name.encode() for name in layout_names(LAYOUT)]
        if dims:
            root["tracks"].attrs["dims"] = json.dumps(["track", "xy", "node", "frame"])
            root["point_scores"].attrs["dims"] = json.dumps(["track", "node", "frame"])
    return path


WRITERS = {"deeplabcut": write_deeplabcut, "sleap": write_sleap}


@KINDS
def test_what_was_written_is_read(kind: str, h5py: Any, tmp_path: Path) -> None:
    people = made.people(LAYOUT)
    path = WRITERS[kind](h5py, tmp_path, people)
    assert format_and_layout(path, None, None) == (kind, LAYOUT)
    detected = read(path, kind, LAYOUT)
    for frame, here in zip(detected.frames, detected.people, strict=True):
        expected = people.get(int(frame), [])
        assert len(here) == len(expected)
        for person, truth in zip(here, expected, strict=True):
            np.testing.assert_allclose(person, truth)


def test_sleaps_own_axes_need_no_names(h5py: Any, tmp_path: Path) -> None:
    people = made.people(LAYOUT, persons=1)
    path = write_sleap(h5py, tmp_path, people, dims=False)
    first = min(people)
    np.testing.assert_allclose(read(path, "sleap", LAYOUT).people[first][0], people[first][0])


@KINDS
def test_without_h5py_it_says_what_to_do(kind, tmp_path, monkeypatch):
    monkeypatch.setattr(array_files, "find_spec", lambda name: None)
    path = tmp_path / "clip.h5"
    path.write_bytes(b"\x89HDF\r\n")
    assert "pip install 'imocap[h5]', or export the results as CSV" in refused(path, kind, LAYOUT)


@KINDS
@pytest.mark.parametrize("content", [b"", b"text", b"\x89HDF\r\n\x1a\n"])
def test_what_is_no_hdf5_is_refused(kind: str, content: bytes, h5py: Any, tmp_path: Path) -> None:
    path = tmp_path / "clip.h5"
    path.write_bytes(content)
    assert "is not readable HDF5" in refused(path, kind, LAYOUT)


def test_another_files_content_is_not_opened(h5py: Any, tmp_path: Path) -> None:
    people = made.people(LAYOUT)
    secret = write_sleap(h5py, tmp_path, people).rename(tmp_path / "secret.h5")
    path = tmp_path / "clip.h5"
    with h5py.File(path, "w") as root:
        for name in ("tracks", "node_names"):
            root[name] = h5py.ExternalLink(str(secret), name)
    assert "expected the datasets tracks and node_names, got nothing" in refused(
        path, "sleap", LAYOUT
    )
    layout = h5py.VirtualLayout(shape=(2, 2, 17, 3), dtype="f8")
    layout[:] = h5py.VirtualSource(str(secret), "tracks", shape=(2, 2, 17, 3))
    with h5py.File(path, "w") as root:
        root.create_virtual_dataset("tracks", layout)
        root["node_names"] = [name.encode() for name in layout_names(LAYOUT)]
    assert "its content is in other files" in refused(path, "sleap", LAYOUT)


def test_what_unpacks_to_too_much_is_refused(h5py: Any, tmp_path: Path) -> None:
    path = tmp_path / "clip.h5"
    with h5py.File(path, "w") as root:
        root.create_dataset("tracks", (9, 2, 17, 10**6), "f8", compression="gzip")
        root["node_names"] = [name.encode() for name in layout_names(LAYOUT)]
    assert "unpacks to more than" in refused(path, "sleap", LAYOUT)


@pytest.mark.parametrize("name", ["info", "values_block_0_kind"])
def test_a_pickle_among_the_attributes_runs_nothing(name: str, h5py: Any, tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    path = write_deeplabcut(h5py, tmp_path, made.people(LAYOUT), **{name: touching(victim)})
    assert f"{name}: refused, it cannot be read safely" in refused(path, "deeplabcut", LAYOUT)
    assert not victim.exists()
    pickle.loads(pickle.dumps(touching(victim)))
    assert victim.exists()  # it would have


@pytest.mark.parametrize(
    "changes",
    [
        {"info": {1: {"names": ["scorer", "coords"]}}},
        {"info": 7},
        {"values_block_0_kind": [("DLC", "p0", "nose", "x")]},
        {"values_block_0_kind": [1, 2]},
    ],
)
def test_other_headings_are_refused(changes: Any, h5py: Any, tmp_path: Path) -> None:
    path = write_deeplabcut(h5py, tmp_path, made.people(LAYOUT), **changes)
    assert "expected" in refused(path, "deeplabcut", LAYOUT)


@pytest.mark.parametrize("index", [("index", "<i8", (2,)), ("index", "<f8"), ("time", "<i8")])
def test_other_frame_numbers_are_refused(index: Any, h5py: Any, tmp_path: Path) -> None:
    path = write_deeplabcut(h5py, tmp_path, made.people(LAYOUT))
    with h5py.File(path, "r+") as root:
        table = root["df_with_missing/table"]
        rows, attributes = table[()], dict(table.attrs)
        changed = np.zeros(len(rows), [index, ("values_block_0", rows.dtype["values_block_0"])])
        changed["values_block_0"] = rows["values_block_0"]
        del root["df_with_missing/table"]
        root["df_with_missing/table"] = changed
        root["df_with_missing/table"].attrs.update(attributes)
    assert "table: expected index and values" in refused(path, "deeplabcut", LAYOUT)


def test_a_table_without_frames_is_refused_as_such(h5py: Any, tmp_path: Path) -> None:
    path = write_deeplabcut(h5py, tmp_path, made.people(LAYOUT))
    with h5py.File(path, "r+") as root:
        table = root["df_with_missing/table"]
        rows, attributes = table[:0], dict(table.attrs)
        del root["df_with_missing/table"]
        root["df_with_missing/table"] = rows
        root["df_with_missing/table"].attrs.update(attributes)
    assert "expected at least one person, got none" in refused(path, "deeplabcut", LAYOUT)


@KINDS
def test_truncated_files_are_refused(kind: str, h5py: Any, tmp_path: Path) -> None:
    path = WRITERS[kind](h5py, tmp_path, made.people(LAYOUT))
    whole = path.read_bytes()
    for share in np.linspace(0, 0.98, 5):
        path.write_bytes(whole[: int(share * len(whole))])
        assert "is not readable HDF5" in refused(path, kind, LAYOUT)


def test_a_file_of_pandas_own_is_read(h5py: Any, tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    pytest.importorskip("tables", reason="PyTables, which pandas writes .h5 with, is not installed")
    names = layout_names(LAYOUT)
    columns = pandas.MultiIndex.from_product(
        [["DLC_resnet50"], names, COORDS], names=["scorer", "bodyparts", "coords"]
    )
    values = np.random.default_rng(0).random((5, 51))
    frame = pandas.DataFrame(values, columns=columns, index=[0, 1, 2, 4, 7])
    path = tmp_path / "clip.h5"
    frame.to_hdf(path, key="df_with_missing", format="table", mode="w")
    detected = read(path, *format_and_layout(path, None, None))
    assert detected.frames.tolist() == [0, 1, 2, 4, 7]
    np.testing.assert_array_equal(np.concatenate(detected.people), values.reshape(5, 17, 3))
    frame.to_hdf(path, key="df_with_missing", mode="w")
    assert "expected a pandas table (frame_table), got frame;" in refused(
        path, "deeplabcut", LAYOUT
    )


@pytest.mark.parametrize("preset", ["matlab", "standard"])
def test_a_file_of_sleap_ios_own_is_read(preset: str, h5py: Any, tmp_path: Path) -> None:
    sio = pytest.importorskip("sleap_io", reason="sleap-io is not installed")
    analysis = import_module("sleap_io.io.analysis_h5")
    names, rng = layout_names(LAYOUT), np.random.default_rng(1)
    skeleton, video = sio.Skeleton(list(names)), sio.Video("clip.mp4")
    tracks, frames, truth = [sio.Track("a"), sio.Track("b")], [], {}
    for t, count in ((0, 2), (1, 1), (3, 2)):
        truth[t] = rng.random((count, 17, 3))
        people = [
            sio.PredictedInstance.from_numpy(
                person[:, :2], skeleton=skeleton, point_scores=person[:, 2], score=0.9, track=track
            )
            for person, track in zip(truth[t], tracks, strict=False)
        ]
        frames.append(sio.LabeledFrame(video=video, frame_idx=t, instances=people))
    path = tmp_path / "clip.analysis.h5"
    analysis.write_labels(sio.Labels(frames), path, preset=preset)
    detected = read(path, *format_and_layout(path, None, None))
    assert detected.frames.tolist() == [0, 1, 2, 3]
    for t, expected in truth.items():
        np.testing.assert_allclose(detected.people[t], expected, atol=1e-6)
    assert len(detected.people[2]) == 0


def test_a_file_from_which_the_library_does_not_come_back_is_refused(h5py, tmp_path, monkeypatch):
    path = write_sleap(h5py, tmp_path, made.people(LAYOUT))
    monkeypatch.setattr(array_files, "TRIAL_S", 1e-3)  # less than any process takes to start
    assert "has not finished reading it" in refused(path, "sleap", LAYOUT)


def test_a_file_on_which_the_library_breaks_down_is_refused(h5py, tmp_path, monkeypatch):
    path = write_sleap(h5py, tmp_path, made.people(LAYOUT))
    (tmp_path / "broken_trial.py").write_text("import os; os.abort()")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    monkeypatch.setattr(array_files, "TRIAL", "broken_trial")
    assert "breaks down on it" in refused(path, "sleap", LAYOUT)


def test_the_trial_reads_all_parts_and_ends_with_parts_in_circles(h5py, tmp_path):
    path = tmp_path / "circle.h5"
    with h5py.File(path, "w") as root:
        inner = root.create_group("a/b")
        inner["numbers"] = np.arange(5)
        inner["again"] = root["a"]
        inner["elsewhere"] = h5py.ExternalLink("other.h5", "/")
    array_files.must_come_back(path, 0)


def test_a_file_is_tried_once(h5py: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_sleap(h5py, tmp_path, made.people(LAYOUT))
    read(path, "sleap", LAYOUT)
    monkeypatch.setattr(array_files, "TRIAL_S", 1e-3)
    read(path, "sleap", LAYOUT)
    os.utime(path, (0.0, 0.0))
    assert "has not finished reading it" in refused(path, "sleap", LAYOUT)

"""What is written is read back, whatever happens to the file is noticed; arrays are checked where
they enter."""

import dataclasses
import json
from pathlib import Path
from types import GenericAlias
from typing import Annotated

import numpy as np
import numpy.typing as npt
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from mcap.reader import make_reader
from mcap.records import Chunk
from pydantic import ValidationError

from imocap_core import limits
from imocap_core.artifacts import codec
from imocap_core.artifacts import codec as ndarray
from imocap_core.artifacts.codec import Content
from imocap_core.artifacts.schemas import (
    CameraMotion,
    Evaluate,
    Floats,
    HandKeypoints,
    Ints,
    Keypoints,
    RefineSync,
    Shape,
    Sync,
    SyncMap,
    Table,
    Value,
)
from imocap_core.artifacts.schemas.base import dtype_of
from imocap_core.errors import ArtifactCorrupt
from tests.made_keypoints import made_keypoints
from tools import make_artifact_docs as tool


def write(file: Path, content: Content) -> Path:
    with file.open("wb") as stream:
        codec.write(stream, content, Sync.model_json_schema())
    return file


@pytest.fixture
def content(sync: Sync) -> Content:
    packed = codec.pack(sync)
    return dataclasses.replace(
        packed, provenance={"key": "k"}, files={"tables/a.csv": b"x,y\n", "empty": b""}
    )


def test_round_trip(tmp_path: Path, sync: Sync, content: Content) -> None:
    read = codec.read(write(tmp_path / "a.mcap", content))
    back = codec.unpack(read, Sync)
    assert read.digest == content.digest == codec.pack(back).digest
    assert read.provenance == content.provenance
    assert read.files == content.files
    np.testing.assert_array_equal(back.maps[1].reference_frame, sync.maps[1].reference_frame)
    np.testing.assert_array_equal(back.centrality, sync.centrality)
    assert back.affinity[0].scaled.dtype == np.uint16
    assert back.relaxed.entries.dtype == np.float32
    assert back.relaxed.entries.flags.writeable


def test_the_same_content_gives_the_same_bytes(tmp_path: Path, content: Content) -> None:
    one, two = (write(tmp_path / name, content).read_bytes() for name in ("a", "b"))
    assert one == two


def test_digest_is_of_the_content_alone(content: Content) -> None:
    other = dataclasses.replace(content, provenance={"key": "other"}, files={})
    assert other.digest == content.digest
    entries = content.arrays["relaxed/entries"]
    changed = {**content.arrays, "relaxed/entries": entries + 1e-6}
    assert dataclasses.replace(content, arrays=changed).digest != content.digest
    flat = {**content.arrays, "relaxed/entries": entries.reshape(2, -1)}
    assert dataclasses.replace(content, arrays=flat).digest != content.digest


def test_every_flipped_byte_is_noticed(tmp_path: Path, content: Content) -> None:
    whole = write(tmp_path / "a.mcap", content).read_bytes()
    file = tmp_path / "b.mcap"
    rng = np.random.default_rng(0)
    places = rng.choice(len(whole), size=min(len(whole), 600), replace=False)
    ends = [*range(40), *range(len(whole) - 60, len(whole))]
    for place in {*places.tolist(), *ends}:
        damaged = bytearray(whole)
        damaged[place] ^= 1 << int(rng.integers(8))
        file.write_bytes(damaged)
        with pytest.raises(ArtifactCorrupt):
            codec.read(file)


def test_every_shortened_file_is_noticed(tmp_path: Path, content: Content) -> None:
    whole = write(tmp_path / "a.mcap", content).read_bytes()
    file = tmp_path / "b.mcap"
    for length in range(0, len(whole), 37):
        file.write_bytes(whole[:length])
        with pytest.raises(ArtifactCorrupt, match=r"b\.mcap"):
            codec.read(file)


@given(noise=st.binary(max_size=300))
def test_no_noise_is_an_artifact(tmp_path_factory: pytest.TempPathFactory, noise: bytes) -> None:
    file = tmp_path_factory.mktemp("noise") / "a.mcap"
    file.write_bytes(noise)
    with pytest.raises(ArtifactCorrupt):
        codec.read(file)


def test_a_small_file_does_not_unpack_to_a_large_one(tmp_path, monkeypatch, content):
    zeros = dataclasses.replace(content, arrays=content.arrays | {"zeros": np.zeros(10**6)})
    file = write(tmp_path / "small.mcap", zeros)
    assert file.stat().st_size < 10**5
    assert np.array_equal(codec.read(file).arrays["zeros"], np.zeros(10**6))
    monkeypatch.setattr(limits, "MAX_UNPACKED_BYTES", 10**6)
    with pytest.raises(ArtifactCorrupt, match=r"small\.mcap: its .* bytes would unpack to 8,"):
        codec.read(file)


def test_a_chunk_that_understates_its_size_is_not_believed(tmp_path, monkeypatch, content):
    zeros = dataclasses.replace(content, arrays={"zeros": np.zeros(10**6)})
    file = write(tmp_path / "small.mcap", zeros)
    monkeypatch.setattr(limits, "MAX_UNPACKED_BYTES", 10**6)
    read = Chunk.read

    def understated(stream: object) -> Chunk:
        return dataclasses.replace(read(stream), uncompressed_size=1)  # type: ignore[arg-type]

    monkeypatch.setattr(Chunk, "read", understated)
    with pytest.raises(ArtifactCorrupt, match="would unpack to 8,"):
        codec.read(file)


def test_another_kind_is_refused(content: Content) -> None:
    with pytest.raises(ArtifactCorrupt, match="expected a CameraMotion, got a Sync"):
        codec.unpack(content, CameraMotion)


@pytest.mark.parametrize(
    ("part", "text"),
    [
        ("inputs", "{"),
        ("inputs", '{"sync": 3}'),
        ("reads", "[]"),
        ("params", '{"sync": 3}'),
        ("params", '{"sync": ' + 60 * "[" + 60 * "]" + "}"),
        ("code", '"c1"'),
        ("code", 100_000 * "["),
        ("seed", '"7"'),
        ("format", "9" * 5000),
    ],
)
def test_a_recipe_of_another_form_makes_its_artifact_corrupt(tmp_path, content, part, text):
    recipe = {"inputs": "{}", "params": '{"sync": {"rank": 3}}', "seed": "7"}
    codec.read(write(tmp_path / "a.mcap", dataclasses.replace(content, provenance=recipe)))
    damaged = dataclasses.replace(content, provenance={**recipe, part: text})
    with pytest.raises(ArtifactCorrupt, match=f"b.mcap: its provenance has no usable {part}"):
        codec.read(write(tmp_path / "b.mcap", damaged))


def test_a_text_that_a_terminal_would_obey_makes_its_artifact_corrupt(content: Content) -> None:
    table = Table(name="t", title="a", columns=["x"], rows=[["b\x1b[2J"]])
    packed = codec.pack(Evaluate(tables=[table], files=[]))
    with pytest.raises(ArtifactCorrupt, match="text with control characters") as error:
        codec.unpack(packed, Evaluate)
    assert "\x1b" not in str(error.value)
    name = json.dumps({"\x1b[31mreference": 1})
    with pytest.raises(ArtifactCorrupt, match="does not fit") as error:
        codec.unpack(dataclasses.replace(content, header=name.encode()), Sync)
    assert "\x1b" not in str(error.value)


@pytest.mark.parametrize("header", ['{"maps": {"$array": []}}', 100_000 * "[", "3", '{"maps": 1}'])
def test_a_header_of_another_form_does_not_fit(content: Content, header: str) -> None:
    with pytest.raises(ArtifactCorrupt, match="does not fit the schema Sync"):
        codec.unpack(dataclasses.replace(content, header=header.encode()), Sync)


def test_numbers_that_json_has_not() -> None:
    rows = [["a", 1.5, None], ["b", 2, True]]
    table = Table(name="t", title="T", columns=["n", "x", "y"], rows=rows)
    made = Evaluate(tables=[table], files=[])
    back = codec.unpack(codec.pack(made), Evaluate)
    assert back.tables[0].rows == rows


def test_another_mcap_reader_sees_topics_and_schemas(tmp_path: Path, content: Content) -> None:
    with write(tmp_path / "a.mcap", content).open("rb") as stream:
        summary = make_reader(stream).get_summary()
    topics = {channel.topic for channel in summary.channels.values()}
    assert {"/header", "/relaxed/entries", "/maps/1/reference_frame"} <= topics
    assert {s.name for s in summary.schemas.values()} == {"imocap.Sync", "imocap.NdArray"}


@given(
    array=arrays.arrays(
        dtype=st.sampled_from([np.float64, np.float32, np.int64]),
        shape=arrays.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=4),
    )
)
def test_arrays_round_trip(array: np.ndarray) -> None:
    name, back = ndarray.from_bytes(ndarray.to_bytes("a/b", array))
    assert name == "a/b"
    assert back.dtype == array.dtype
    np.testing.assert_array_equal(back, array)


def test_strided_and_big_endian_arrays_are_written_in_order() -> None:
    array = np.arange(12.0).reshape(3, 4)
    for same in (np.asfortranarray(array), array.astype(">f8"), np.repeat(array, 2, 1)[:, ::2]):
        assert ndarray.to_bytes("x", same) == ndarray.to_bytes("x", array)


def test_what_is_optional_is_not_written_when_there_is_none() -> None:
    video = made_keypoints(np.arange(2))
    without = codec.pack(Keypoints(videos=[video]))
    assert b"hands" not in without.header
    assert b'"video":null' in without.header
    assert codec.unpack(without, Keypoints).videos[0].hands is None
    hands = HandKeypoints(xy_px=np.zeros((2, 2, 21, 2)), confidence=np.ones((2, 2, 21)))
    held = codec.pack(Keypoints(videos=[video.model_copy(update={"hands": hands})]))
    found = codec.unpack(held, Keypoints).videos[0].hands
    assert np.array_equal(found.confidence, hands.confidence)


class Path2D(Value):
    frames: Annotated[Ints, Shape("T")]
    xy: Annotated[Floats, Shape("T", 2)]
    extra: Annotated[Floats, Shape("*", "*")]


def make(frames: object, xy: object, extra: object = ((0.0,),)) -> Path2D:
    return Path2D(frames=frames, xy=xy, extra=extra)


def test_arrays_get_their_type_and_keep_their_shape() -> None:
    made = make([1, 2], [[0, 1], [2, 3]], np.zeros((5, 0)))
    assert made.frames.dtype == np.int64
    assert made.xy.dtype == np.float64
    assert made.xy.shape == (2, 2)
    assert made.extra.shape == (5, 0)


@pytest.mark.parametrize(
    "array_type",
    [
        np.ndarray[tuple[int, ...], np.dtype[np.float32]],  # NumPy's NDArray before 2.5
        GenericAlias(npt.NDArray, (np.float32,)),  # what it is from there on
    ],
)
def test_a_dtype_is_read_from_either_form_of_annotation(array_type: object) -> None:
    assert dtype_of(array_type) == np.float32
    with pytest.raises(TypeError, match="names no dtype"):
        dtype_of(np.ndarray)


def test_an_array_is_not_copied_when_it_already_fits() -> None:
    xy = np.zeros((2, 2))
    assert np.shares_memory(make([1, 2], xy).xy, xy)


@pytest.mark.parametrize(
    ("frames", "xy", "said"),
    [
        ([1, 2], np.zeros((2, 3)), r"xy[\s\S]*expected an array of shape \(T, 2\), got \(2, 3\)"),
        ([1, 2], np.zeros(2), r"expected an array of shape \(T, 2\), got \(2,\)"),
        ([1, 2], np.zeros((3, 2)), "xy has T = 3, but frames has T = 2"),
        ([1.5, 2], np.zeros((2, 2)), "frames[\\s\\S]*expected an array of int64, got float64"),
        ([1, 2], [["a", "b"], ["c", "d"]], "expected an array of float64, got <U1"),
    ],
)
def test_what_does_not_fit_is_named(frames: object, xy: object, said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        make(frames, xy)


def test_values_do_not_change_and_know_no_other_fields() -> None:
    made = make([1], [[0.0, 0.0]])
    with pytest.raises(ValidationError, match="frozen"):
        made.frames = np.zeros(1)
    with pytest.raises(ValidationError, match="Extra inputs"):
        Path2D(frames=[1], xy=[[0.0, 0.0]], extra=[[0.0]], more=1)


def test_sync_refuses_maps_that_do_not_belong(sync: Sync) -> None:
    fields = {name: getattr(sync, name) for name in type(sync).model_fields}
    with pytest.raises(ValidationError, match="reference: expected one of"):
        Sync(**{**fields, "reference": "z"})
    with pytest.raises(ValidationError, match=r"maps: expected lengths \[3, 3\], got \[3, 2\]"):
        Sync(**{**fields, "lengths": [3, 3]})
    short = SyncMap(id="a", reference_frame=[0.0], confidence=[1.0])
    with pytest.raises(ValidationError, match="expected unique ids, got a twice"):
        Sync(**{**fields, "ids": ["a", "a"], "maps": [short, short]})


def test_a_table_is_rectangular() -> None:
    with pytest.raises(ValidationError, match="row 1 has 1 cells, expected 2"):
        Table(name="t", title="", columns=["a", "b_mm"], rows=[["x", 1.0], ["y"]])


def test_json_schema_says_what_the_arrays_are() -> None:
    schema = RefineSync.model_json_schema()
    theta = schema["$defs"]["VideoMotion"]["properties"]["theta"]
    assert theta["description"].startswith("float64 array of shape (T, 72)")


ROOT = Path(__file__).resolve().parents[2]


def test_the_page_is_up_to_date() -> None:
    assert (ROOT / "docs" / "artifacts.md").read_text() == tool.document(), (
        "run: python tools/make_artifact_docs.py"
    )
    graph = yaml.safe_load((ROOT / "pipeline.yaml").read_text())["stages"]
    assert list(tool.BY_STAGE) == list(graph)

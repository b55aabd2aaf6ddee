"""Files that ask for too much are refused in a sentence, before room is made for what they ask."""

import bz2
import gzip
import lzma
import os
import pickle
import struct
import zlib
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from imocap_core import limits
from imocap_core.errors import WorkFailed
from imocap_core.io.array_files import read_object, read_results
from imocap_core.io.npz import load_arrays
from imocap_core.io.readers.json_people import read_openpose
from imocap_core.io.readers.people import read_json
from imocap_core.io.video import probe, read_rgb, write_h264
from imocap_core.pipeline.source import content_digest
from imocap_core.pipeline.yaml_file import load_yaml
from imocap_core.unpickle import UNREADABLE, load_pickle

ZEROS = pickle.dumps({"poses": b"\0" * 2**20})


@pytest.fixture
def little(monkeypatch: pytest.MonkeyPatch) -> None:
    """Room for half of the zeros."""
    for module in ("imocap_core.limits", "imocap_core.io.array_files"):
        monkeypatch.setattr(f"{module}.MAX_UNPACKED_BYTES", 2**19)


@pytest.mark.parametrize("pack", [zlib.compress, gzip.compress, bz2.compress, lzma.compress])
def test_a_compressed_pickle_unpacks_to_little(tmp_path, pack, request):
    file = tmp_path / "a.pkl"
    file.write_bytes(pack(ZEROS))
    assert read_results(file) == {"poses": b"\0" * 2**20}
    request.getfixturevalue("little")
    with pytest.raises(ValueError, match=r"a\.pkl: refused, .*unpacks to more than 0 MiB"):
        read_results(file)


@pytest.mark.usefixtures("little")
@pytest.mark.parametrize("read", [load_arrays, lambda path: read_object(path, "a"), read_results])
def test_a_zip_file_unpacks_to_little(tmp_path: Path, read: Callable[[Path], Any]) -> None:
    file = tmp_path / "a.npz"
    np.savez_compressed(file, a=np.zeros(2**17))
    with pytest.raises(ValueError, match=r"a\.npz: .*unpacks to more than 0 MiB"):
        read(file)


NESTED = b")" + b"2\x86" * 60  # a tuple of the one before twice, sixty times: 2^60 parts
HOSTILE = {
    "a bytearray of many bytes": b"\x80\x05\x96" + struct.pack("<Q", 2**62) + b".",
    "a bytearray of a size": b"cbuiltins\nbytearray\n(I1000000000000\ntR.",
    "a dictionary with such a key": b"\x80\x02}" + NESTED + b"K\x01s.",
    "several such keys": b"\x80\x02}(" + NESTED + b"K\x01u.",
    "a dictionary made at once": b"(" + NESTED + b"I1\nd.",
    "a dictionary that is called": b"cbuiltins\ndict\n(](" + NESTED + b"I1\ntatR.",
    "a set": b"\x80\x04\x8f(" + NESTED + b"\x90.",
    "a frozen set": b"\x80\x04(" + NESTED + b"\x91.",
    "a set that is called": b"cbuiltins\nset\n(](" + NESTED + b"tatR.",
    "lists of lists": b"\x80\x02" + NESTED + b".",
    "a list that holds itself": b"\x80\x02]q\x00h\x00a.",
}


@pytest.mark.parametrize("content", HOSTILE.values(), ids=HOSTILE.keys())
def test_a_pickle_asks_for_no_more_than_it_holds(content: bytes) -> None:
    with pytest.raises(UNREADABLE):
        load_pickle(content)


def test_integers_of_any_length_are_numbers_or_missing(tmp_path: Path) -> None:
    for digits in ("9" * 310, "9" * 5000, "-" + "9" * 5000):
        points = ",".join([digits, "2", "0.9"] + ["1", "2", "0.9"] * 24)
        text = '{"people": [{"pose_keypoints_2d": [' + points + "]}]}"
        (tmp_path / "f_0.json").write_text(text)
        people = read_openpose(tmp_path, "body25").people[0]
        assert np.isnan(people[0, 0, :2]).all()
        np.testing.assert_array_equal(people[0, 1:, :2], np.tile([1.0, 2.0], (24, 1)))


def test_nested_json_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    file.write_text("[" * 100_000 + "]" * 100_000)
    with pytest.raises(ValueError, match=r"a\.json: is not JSON"):
        read_json(file)


def yaml_of(tmp_path: Path, text: str) -> Any:
    file = tmp_path / "action.yaml"
    file.write_text(text)
    return load_yaml(file)


LAUGHS = "a0: &a0 [x, x]\n" + "".join(f"a{n}: &a{n} [*a{n - 1}, *a{n - 1}]\n" for n in range(1, 60))
MERGES = "a0: &a0 {x: 1}\n" + "".join(
    f"a{n}: &a{n} {{<<: [*a{n - 1}, *a{n - 1}]}}\n" for n in range(1, 60)
)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (LAUGHS, "expected at most 200,000 values, its aliases stand for more"),
        (MERGES, "expected at most 200,000 values, its aliases stand for more"),
        ("a: &a [*a]\n", "an alias contains itself"),
        ("a: &a {<<: *a}\n", "an alias contains itself"),
        ("[" * 5000, "is not YAML"),
        ("- " * 5000, "is not YAML"),
        ("fps: " + "9" * 5000, "Exceeds the limit"),
        ("day: 2020-13-45\n", "month must be in"),
        ("? [a, b]\n: 1\n? {a: 1}\n: 2\n", "is not YAML"),
        ("a: " + "x" * (limits.MAX_YAML_BYTES + 1), "expected at most 4 MiB"),
    ],
    ids=["aliases", "merges", "itself", "merged", "deep", "dashes", "digits", "day", "key", "long"],
)
def test_yaml_stands_for_no_more_than_it_says(tmp_path: Path, text: str, why: str) -> None:
    with pytest.raises(WorkFailed, match=why) as failed:
        yaml_of(tmp_path, text)
    assert "action.yaml" in str(failed.value)
    assert "\n" not in str(failed.value)
    plain = "base: &b {fps: 30}\nvideos: [{<<: *b, id: v1}, {<<: *b, id: v2}]\n"
    assert yaml_of(tmp_path, plain)["videos"][1] == {"fps": 30, "id": "v2"}


def test_a_pipe_is_no_input(tmp_path: Path) -> None:
    pipe = tmp_path / "action.yaml"
    os.mkfifo(pipe)
    with pytest.raises(WorkFailed, match="expected a file"):
        load_yaml(pipe)
    with pytest.raises(WorkFailed, match="expected a file or a folder"):
        content_digest(pipe)


def test_a_header_that_claims_a_billion_frames_is_counted(tmp_path: Path) -> None:
    file = tmp_path / "a.avi"
    pictures = [np.full((48, 64, 3), 20 * n, np.uint8) for n in range(10)]
    with av.open(str(file), "w") as container:
        stream: Any = container.add_stream("mjpeg", rate=Fraction(25))
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuvj420p"
        for picture in pictures:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())
    data = bytearray(file.read_bytes())
    for place in (data.index(b"avih") + 8 + 16, data.index(b"strh") + 8 + 32):
        assert struct.unpack_from("<I", data, place) == (10,)
        struct.pack_into("<I", data, place, 10**9)
    file.write_bytes(data)
    assert probe(file).frame_count == 10


def test_a_picture_that_claims_too_many_pixels_is_not_decoded(tmp_path, monkeypatch):
    file = tmp_path / "a.mp4"
    write_h264(file, [np.zeros((48, 64, 3), np.uint8)] * 3, 25)
    monkeypatch.setattr("imocap_core.io.video.MAX_PIXELS", 64 * 48 - 1)
    for read in (probe, lambda path: next(read_rgb(path))):
        with pytest.raises(ValueError, match=r"a\.mp4: expected pictures of at most .* 64 x 48"):
            read(file)

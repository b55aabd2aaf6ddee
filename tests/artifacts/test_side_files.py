"""An artifacts folder from somebody else writes nothing outside itself."""

import json
import os
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import pytest

from imocap_core.artifacts import codec
from imocap_core.artifacts.schemas import Keypoints
from imocap_core.artifacts.side_files import check_names, replace_folder
from imocap_core.artifacts.store import Store
from imocap_core.errors import ArtifactCorrupt, WorkFailed
from tools.fuzz.recoded import VIDEO

OUTSIDE = (
    "../x",
    "../../../toys/gather.py",
    "a/../../x",
    "/tmp/x",
    "C:/x",
    "C:x",
    "..\\x",
    "a//x",
    "a/",
    "./x",
    ".hidden",
    "",
    "x\0y",
    "x\n",
    "a" * 200,
    "/".join("a" * 9),
    "NUL",  # of Windows' devices, with any ending
    "aux.csv",
    "figures/com1.png",
    "lpt9.tar.gz",
    "x.",
    "x ",
    "a /x",
)


@pytest.mark.parametrize("name", OUTSIDE)
def test_an_attachment_that_names_another_place_makes_its_artifact_corrupt(name, sync, tmp_path):
    packed = codec.pack(sync)
    file = tmp_path / "sync.mcap"
    content = codec.Content(packed.schema, packed.header, packed.arrays, {}, {name: b"planted"})
    stream = BytesIO()
    codec.write(stream, content, {})
    file.write_bytes(stream.getvalue())
    with pytest.raises(ArtifactCorrupt, match="side file is named"):
        codec.read(file)
    with pytest.raises(ValueError, match="side file is named"):
        replace_folder(tmp_path / "report", {name: b"planted"})
    assert [p.name for p in tmp_path.iterdir()] == ["sync.mcap"]


@pytest.mark.parametrize("name", ["../../v1", "/tmp/v1", "v1\n", "", ".hidden", "a b", "v\x1b[2J"])
def test_a_video_of_another_name_makes_its_artifact_corrupt(name: str) -> None:
    packed = codec.pack(Keypoints(videos=[VIDEO]))
    header = json.loads(packed.header)
    header["videos"][0]["id"] = name  # exports and films are named after the video
    content = replace(packed, header=json.dumps(header).encode())
    with pytest.raises(ArtifactCorrupt, match="does not fit the schema Keypoints"):
        codec.unpack(content, Keypoints)


def test_names_of_a_report_are_distinct_files() -> None:
    check_names(["index.md", "figures/cam 01_a-b.png", "figures/deep/x.csv"])
    check_names(["console.md", "com10.csv", "nullable/x.png"])
    for names in (["a", "a"], ["a", "a/b"], ["a", "A"], ["A", "a/b"]):
        with pytest.raises(ValueError, match="two side files are named 'a'"):
            check_names(names)


@pytest.mark.parametrize("place", ["yoga", "yoga/report", "yoga/report/report.html", ".cache/sync"])
def test_a_link_that_leads_out_of_the_store_is_refused(tmp_path: Path, place: str) -> None:
    store = Store(tmp_path / "artifacts")
    outside = tmp_path / "mine"
    outside.mkdir()
    link = store.folder / place
    link.parent.mkdir(parents=True)
    link.symlink_to(outside, target_is_directory=True)
    with (
        pytest.raises(WorkFailed, match=r"is a link to .*mine, outside"),
        store.lock("yoga", print),
    ):
        pass
    assert list(outside.iterdir()) == []


def test_links_within_the_store_and_of_the_store_are_fine(tmp_path: Path) -> None:
    (tmp_path / "disk" / "yoga").mkdir(parents=True)
    os.symlink(tmp_path / "disk", tmp_path / "artifacts")
    (tmp_path / "disk" / "yoga" / "again").symlink_to("../yoga")
    with Store(tmp_path / "artifacts").lock("yoga", print):
        pass

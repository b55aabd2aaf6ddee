"""`imocap push` and `pull`: an action goes to another machine whole, and to nowhere else."""

import json
import shutil
import zipfile
from pathlib import Path

import pytest

import imocap
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.library.shared_action import must_be_inside, pack, unpack
from imocap_core.pipeline.graph import VARIABLE
from tests.pipeline.conftest import Toy

OUTSIDE = ["../v1.txt", "a/../../b", "/etc/passwd", "..", "", "a\\..\\b", "c:/x", "a\nb", ".git/x"]


@pytest.fixture
def store(tmp_path: Path) -> str:
    (tmp_path / "shared").mkdir()
    return str(tmp_path / "shared")


@pytest.fixture
def elsewhere(toy: Toy, tmp_path: Path) -> Path:
    """Another working folder with the same pipeline."""
    root = tmp_path / "elsewhere"
    root.mkdir()
    shutil.copy(toy.root / "pipeline.yaml", root)
    shutil.copytree(toy.root / "toys", root / "toys")
    return root


def with_folder(toy: Toy) -> None:
    """The action names a folder, and a file of a name that people give."""
    (toy.action / "frames/a").mkdir(parents=True)
    (toy.action / "frames/a/0.json").write_text("{}")
    (toy.action / "frames/.DS_Store").write_text("x")
    (toy.action / "my clip (1).txt").write_text("2.5")
    text = (toy.action / "action.yaml").read_text()
    text = text.replace("v2.txt", "my clip (1).txt").replace("id: v1,", "id: v1, video: frames,")
    (toy.action / "action.yaml").write_text(text)


def record(store: str) -> Path:
    return Path(store) / "actions/toy.json"


def test_a_pushed_action_is_pulled_with_its_results(toy: Toy, store: str, elsewhere: Path) -> None:
    with_folder(toy)
    assert toy.imocap(["run", "toy"]) == 0
    pushed = imocap.push("toy", store=store, root=toy.root)
    assert sorted(pushed.new_files) == ["action.yaml", "frames/", "my clip (1).txt", "v1.txt"]
    assert pushed.results == ["gather", "scale", "evaluate"]
    pulled = imocap.pull("toy", store=store, root=elsewhere)
    assert pulled.new
    assert (pulled.results, pulled.missing) == (pushed.results, [])
    for name in ("action.yaml", "my clip (1).txt", "frames/a/0.json", "frames/.DS_Store"):
        assert (elsewhere / "actions/toy" / name).read_bytes() == (toy.action / name).read_bytes()
    assert {s.state for s in imocap.status("toy", root=elsewhere)} == {"cached"}
    assert (elsewhere / "artifacts/toy/report/index.md").is_file()
    assert not imocap.pull("toy", store=store, root=elsewhere).new
    assert imocap.push("toy", store=store, root=elsewhere).new_files == []


def test_a_file_that_two_actions_use_is_stored_once(toy: Toy, store: str) -> None:
    imocap.push("toy", store=store, root=toy.root)
    other = toy.root / "actions/other"
    shutil.copytree(toy.action, other)
    text = (other / "action.yaml").read_text().replace("name: toy", "name: other")
    (other / "action.yaml").write_text(text)
    assert imocap.push("other", store=store, root=toy.root).new_files == ["action.yaml"]


def test_what_was_pulled_follows_the_store_until_somebody_changes_it(toy, store, elsewhere):
    imocap.push("toy", store=store, root=toy.root)
    imocap.pull("toy", store=store, root=elsewhere)
    (toy.action / "v1.txt").write_text("7")
    with pytest.raises(WorkFailed, match=r"has an action toy of other content \(v1.txt\)"):
        imocap.push("toy", store=store, root=toy.root)
    imocap.push("toy", store=store, root=toy.root, replace=True)
    assert imocap.pull("toy", store=store, root=elsewhere).new
    theirs = elsewhere / "actions/toy/v1.txt"
    assert theirs.read_text() == "7"
    (elsewhere / "actions/toy/notes.txt").write_text("mine")
    (toy.action / "v1.txt").write_text("8")
    imocap.push("toy", store=store, root=toy.root, replace=True)
    with pytest.raises(WorkFailed, match=r"v1.txt differs.*it stays as it is"):
        imocap.pull("toy", store=store, root=elsewhere)
    assert theirs.read_text() == "7"
    assert (elsewhere / "actions/toy/notes.txt").read_text() == "mine"


OUTSIDE_YAML = """# two clips from elsewhere
name: toy
videos:
  - {id: v1, keypoints: ../../films/clip.txt, fps: 30.0, size: [640, 360]}  # the first
  - {id: v2, keypoints: ../../other/clip.txt, fps: 30.0, size: [640, 360]}
"""


def with_files_elsewhere(toy: Toy) -> None:
    """Both files of the action lie outside its folder, under one name."""
    for folder, number in (("films", "1.0"), ("other", "2.0")):
        (toy.root / folder).mkdir()
        (toy.root / folder / "clip.txt").write_text(number)
    (toy.action / "action.yaml").write_text(OUTSIDE_YAML)


def test_files_outside_the_folder_are_taken_along(toy: Toy, store: str, elsewhere: Path) -> None:
    with_files_elsewhere(toy)
    assert toy.imocap(["run", "toy"]) == 0
    pushed = imocap.push("toy", store=store, root=toy.root)
    assert pushed.files == ["action.yaml", "keypoints/clip.txt", "keypoints/v2_clip.txt"]
    assert (toy.action / "action.yaml").read_text() == OUTSIDE_YAML
    pulled = imocap.pull("toy", store=store, root=elsewhere)
    assert (pulled.results, pulled.missing) == (pushed.results, [])
    there = elsewhere / "actions/toy"
    assert (there / "keypoints/v2_clip.txt").read_text() == "2.0"
    expected = OUTSIDE_YAML.replace("../../films/clip.txt", "keypoints/clip.txt")
    expected = expected.replace("../../other/clip.txt", "keypoints/v2_clip.txt")
    assert (there / "action.yaml").read_text().split() == expected.split()
    states = [imocap.status("toy", root=root) for root in (toy.root, elsewhere)]
    assert {s.state for s in states[1]} == {"cached"}
    assert imocap.push("toy", store=store, root=elsewhere).new_files == []
    assert imocap.push("toy", store=store, root=toy.root).new_files == []


@pytest.mark.long
def test_a_pulled_action_runs_to_the_same_digests(toy, store, elsewhere, monkeypatch):
    with_files_elsewhere(toy)
    imocap.push("toy", store=store, root=toy.root)
    imocap.pull("toy", store=store, root=elsewhere)
    assert toy.imocap(["run", "toy"]) == 0
    monkeypatch.setenv(VARIABLE, str(elsewhere))
    assert Toy(elsewhere).imocap(["run", "toy"]) == 0
    assert toy.digests() == Toy(elsewhere).digests() != {}


def test_what_was_pushed_may_be_pulled_where_it_came_from(toy: Toy, store: str) -> None:
    with_files_elsewhere(toy)
    imocap.push("toy", store=store, root=toy.root)
    assert not imocap.pull("toy", store=store, root=toy.root).new
    assert (toy.action / "action.yaml").read_text() == OUTSIDE_YAML
    (toy.root / "films/clip.txt").write_text("7")
    with pytest.raises(WorkFailed, match="it stays as it is"):
        imocap.pull("toy", store=store, root=toy.root)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("../nowhere.txt", r"videos.0.keypoints: there is no .*nowhere.txt"),
        ("../a:b.txt", r"videos.0.keypoints: ../a:b.txt .* no place on another machine"),
        ("../.hidden/..", r"videos.0.keypoints: ../.hidden/.. .* no place on another machine"),
    ],
)
def test_a_file_that_cannot_be_taken_along_is_named(toy, store, name, sentence):
    (toy.root / "actions/a:b.txt").write_text("1")
    (toy.root / "actions/.hidden").mkdir()
    text = (toy.action / "action.yaml").read_text().replace("v1.txt", f'"{name}"')
    (toy.action / "action.yaml").write_text(text)
    with pytest.raises(WorkFailed, match=sentence):
        imocap.push("toy", store=store, root=toy.root)
    assert not record(store).exists()


def test_a_link_is_taken_along_as_what_it_leads_to(toy: Toy, store: str, elsewhere: Path) -> None:
    (toy.root / "real.txt").write_text("5")
    (toy.root / "actions/link.txt").symlink_to(toy.root / "real.txt")
    text = (toy.action / "action.yaml").read_text().replace("v1.txt", "../link.txt")
    (toy.action / "action.yaml").write_text(text)
    imocap.push("toy", store=store, root=toy.root)
    imocap.pull("toy", store=store, root=elsewhere)
    pulled = elsewhere / "actions/toy/keypoints/link.txt"
    assert pulled.read_text() == "5"
    assert not pulled.is_symlink()


@pytest.mark.parametrize("path", OUTSIDE)
def test_a_record_leads_nowhere_else(toy: Toy, store: str, elsewhere: Path, path: str) -> None:
    imocap.push("toy", store=store, root=toy.root)
    content = json.loads(record(store).read_text())
    content["files"][path] = content["files"]["v1.txt"]
    record(store).write_text(json.dumps(content))
    before = sorted(elsewhere.rglob("*"))
    with pytest.raises(WorkFailed, match=r"actions/toy.json: files"):
        imocap.pull("toy", store=store, root=elsewhere)
    assert sorted(elsewhere.rglob("*")) == before


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda c: c.update(name="other"), "the record of toy is of other"),
        (lambda c: c["files"].pop("v1.txt"), "there is no toy/v1.txt"),
        (lambda c: c["files"].update({"v1.txt": "0" * 64}), "has not inputs/000"),
        (lambda c: c["results"].update({"../x": "0" * 64}), "results"),
        (lambda c: c["results"].update(gather="../../x"), "results.gather"),
        (lambda c: c.update(format=2), "format"),
    ],
)
def test_a_record_that_is_wrong_is_a_sentence_and_nothing_is_written(
    toy, store, elsewhere, change, sentence
):
    imocap.push("toy", store=store, root=toy.root)
    content = json.loads(record(store).read_text())
    change(content)
    record(store).write_text(json.dumps(content))
    with pytest.raises(WorkFailed, match=sentence):
        imocap.pull("toy", store=store, root=elsewhere)
    assert not (elsewhere / "actions/toy").exists()


def test_a_file_of_other_content_is_refused(toy: Toy, store: str, elsewhere: Path) -> None:
    imocap.push("toy", store=store, root=toy.root)
    digest = json.loads(record(store).read_text())["files"]["v1.txt"]
    (Path(store) / "inputs" / digest).write_text("9")
    with pytest.raises(WorkFailed, match=r"which is v1.txt, is damaged"):
        imocap.pull("toy", store=store, root=elsewhere)
    assert not (elsewhere / "actions/toy").exists()
    imocap.push("toy", store=store, root=toy.root, replace=True)
    assert imocap.pull("toy", store=store, root=elsewhere).new


def test_a_link_in_place_of_the_folder_is_not_followed(toy, store, elsewhere, tmp_path):
    imocap.push("toy", store=store, root=toy.root)
    (tmp_path / "private").mkdir()
    (elsewhere / "actions").mkdir()
    (elsewhere / "actions/toy").symlink_to(tmp_path / "private")
    with pytest.raises(WorkFailed, match="stays as it is"):
        imocap.pull("toy", store=store, root=elsewhere)
    assert not list((tmp_path / "private").iterdir())


def test_what_is_not_there_is_named(toy: Toy, store: str) -> None:
    with pytest.raises(WorkFailed, match="has no action dance"):
        imocap.pull("dance", store=store, root=toy.root)
    with pytest.raises(WrongUse, match="invalid action name"):
        imocap.pull("../dance", store=store, root=toy.root)
    assert toy.imocap(["push", "toy"]) == 2


def test_an_archive_is_unpacked_below_its_folder_only(tmp_path: Path) -> None:
    (tmp_path / "in/a").mkdir(parents=True)
    (tmp_path / "in/a/x.json").write_text("1")
    pack(tmp_path / "in", tmp_path / "a.zip")
    unpack(tmp_path / "a.zip", tmp_path / "out")
    assert (tmp_path / "out/a/x.json").read_text() == "1"
    for name in ("../x", "/x", "a/../../x"):
        with zipfile.ZipFile(tmp_path / "b.zip", "w") as archive:
            archive.writestr(name, "bad")
        with pytest.raises(ValueError, match="inside the action's folder"):
            unpack(tmp_path / "b.zip", tmp_path / "out")
    (tmp_path / "c.zip").write_bytes((tmp_path / "a.zip").read_bytes()[:-9])
    with pytest.raises(ValueError, match="no readable archive"):
        unpack(tmp_path / "c.zip", tmp_path / "out")


@pytest.mark.parametrize("path", ["v1.mp4", "a/b/c.json", "Übung (2).mp4", "keypoints/", "a/.x"])
def test_ordinary_paths_are_inside(path: str) -> None:
    assert must_be_inside(path) == path


def test_a_pulled_memory_that_is_nested_without_end_is_as_none(toy, store, elsewhere):
    imocap.push("toy", store=store, root=toy.root)
    imocap.pull("toy", store=store, root=elsewhere)
    (elsewhere / "actions/toy/.pulled.json").write_text(100_000 * "[")
    (toy.action / "v1.txt").write_text("7")
    imocap.push("toy", store=store, root=toy.root, replace=True)
    with pytest.raises(WorkFailed, match="it stays as it is"):
        imocap.pull("toy", store=store, root=elsewhere)


def test_a_playlist_is_no_video_of_an_action(toy: Toy, store: str, elsewhere: Path) -> None:
    (toy.action / "v1.m3u8").write_text("#EXTM3U\n#EXTINF:1,\nfile:///etc/hostname\n")
    text = (toy.action / "action.yaml").read_text()
    (toy.action / "action.yaml").write_text(text.replace("id: v1,", "id: v1, video: v1.m3u8,"))
    imocap.push("toy", store=store, root=toy.root)
    with pytest.raises(WorkFailed, match=r"cannot be used: .*v1.m3u8: "):
        imocap.pull("toy", store=store, root=elsewhere)
    assert not (elsewhere / "actions/toy").exists()

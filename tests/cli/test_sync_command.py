"""`imocap sync`: what it accepts, what it writes, what it says when it can't."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from imocap_core.cli import main
from imocap_core.errors import WrongUse
from imocap_core.io.video import probe, write_h264
from imocap_core.pipeline.action import read_action
from imocap_core.sync.repetition import Repetitions
from imocap_core.sync_sources import labels, read_size, sources_of
from tests.io import made_keypoints
from tests.report.made import FPS, SIZE, Made
from tools.chaos.small_action import sets

Capture = pytest.CaptureFixture[str]

QUICK = sets("initial_smpl")
FORMAT = ["--fps", str(FPS), "--size", f"{SIZE[0]}x{SIZE[1]}"]


def _video(file: Path, frames: int) -> Path:
    file.parent.mkdir(parents=True, exist_ok=True)
    write_h264(file, (np.full((SIZE[1], SIZE[0], 3), 5 * n, np.uint8) for n in range(frames)), FPS)
    return file


@pytest.fixture(scope="module")
def made() -> Made:
    return Made(count=2, frames=24)


@pytest.fixture
def run(tmp_path: Path):
    """`imocap sync WORDS` in a fresh working folder; its exit code."""
    return lambda *words: main(["sync", *map(str, words), "--root", str(tmp_path)])


def _rows(file: Path) -> list[dict[str, str]]:
    with file.open() as stream:
        return list(csv.DictReader(stream))


def test_keypoints_alone_give_a_table_and_a_picture(run, made, tmp_path, capsys):
    folders = [made.write_openpose(tmp_path / "in" / name, v) for v, name in enumerate(("a", "b"))]
    out = tmp_path / "out"
    assert run(*folders, *FORMAT, *QUICK, "--out", out, "--name", "try", "--reference", "b") == 0
    message = capsys.readouterr().out
    assert "mean rate" in message
    assert sorted(f.name for f in out.iterdir()) == ["sync.csv", "sync.png"]
    rows = _rows(out / "sync.csv")
    assert list(rows[0]) == ["video", "frame", "reference_frame", "confidence", "phase_s"]
    assert {row["video"] for row in rows} == {"a"}
    assert len(rows) == 24
    action = read_action(tmp_path / "artifacts" / "try")
    assert [(v.id, v.layout, v.fps) for v in action.videos] == [("a", "body25", FPS)] + [
        ("b", "body25", FPS)
    ]
    assert run(*folders, *FORMAT, *QUICK, "--out", out, "--name", "try", "--reference", "a") == 0
    assert " made" not in capsys.readouterr().out  # the same action again, nothing runs
    assert {row["video"] for row in _rows(out / "sync.csv")} == {"b"}
    words = [*folders, *FORMAT, *QUICK, "--out", out, "--name", "try", "--reference", "a", "--json"]
    assert run(*words) == 0
    document = json.loads(capsys.readouterr().out)
    assert (Path(document["action"]).name, document["reference"]) == ("try", "a")
    assert [video["video"] for video in document["videos"]] == ["a", "b"]
    assert 0 < document["videos"][1]["matched"] <= 1
    assert str(out / "sync.csv") in document["files"]


def test_videos_with_keypoints_give_a_film_too(run, made, tmp_path, capsys):
    clip = _video(tmp_path / "in" / "a.mp4", 24)
    made.write_openpose(tmp_path / "in" / "a_keypoints", 0)
    other = _video(tmp_path / "in" / "b.mp4", 24)
    beside = made.write_openpose(tmp_path / "elsewhere", 1)
    fine = [*QUICK, "--set", "initial_smpl.max_steps=8"]  # two poor fits have no common time
    assert run(clip, f"{other}:{beside}", *fine, "--name", "try") == 0
    out = tmp_path / "artifacts" / "try" / "sync"
    assert sorted(f.name for f in out.iterdir()) == ["side_by_side.mp4", "sync.csv", "sync.png"]
    film = probe(out / "side_by_side.mp4")
    with (out / "sync.csv").open() as stream:  # the film shows all moments of the common time axis
        phases = [float(row["phase_s"]) for row in csv.DictReader(stream)]
    span_s = max(*phases, 23 / FPS) - min(*phases, 0.0)
    assert film.frame_count == pytest.approx(1 + span_s * FPS, abs=1)
    assert 24 <= film.frame_count <= 26  # both clips show the same 24 moments
    assert film.fps == FPS
    assert str(out / "side_by_side.mp4") in capsys.readouterr().out
    assert run(tmp_path / "artifacts" / "try", *fine) == 0  # an action works too


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nowhere"], "there is no nowhere; expected keypoints"),
        (
            ["{in}/a"],
            "frame rate and picture size of keypoints are unknown; give both, as in --fps 30",
        ),
        (["{in}/a", "--fps", "30", "--size", "big"], "--size big: expected width x height"),
        (["{in}/a", *FORMAT], "is one video: give two or more, or cut a long clip"),
        (["{in}/a", "{in}/b", *FORMAT, "--reference", "c"], "there is no such video; got a, b"),
        (["{in}/a", "{in}/b", *FORMAT, "--name", "x/y"], "invalid action name 'x/y'"),
        (["{in}/a", "{in}/b", *FORMAT, "--name", "mine"], "there is another action mine"),
        (["{in}/a", "{in}/b", *FORMAT, "--repetitions"], "expected one long clip, got 2"),
        (["{in}/a", "{in}/b", *FORMAT, "--set", "sync.magic=1"], "sync.magic: unknown parameter"),
        (["{in}/a", "--format", "magic"], "'magic' is not one of"),
        (["yoga", "{in}/a"], "yoga is an action: give it alone"),
        (["{in}/a.mp4:{in}/none"], "there is no"),
    ],
)
def test_wrong_use(run, made, tmp_path, capsys, words, message):
    for v, name in enumerate(("a", "b")):
        made.write_openpose(tmp_path / "in" / name, v, frames=3)
    (tmp_path / "in" / "a.mp4").write_bytes(b"")
    (tmp_path / "actions" / "mine").mkdir(parents=True)
    assert run(*(word.replace("{in}", str(tmp_path / "in")) for word in words)) == 2
    shown = capsys.readouterr().err
    assert message in " ".join(shown.replace("│", " ").split())
    assert "Traceback" not in shown


def test_videos_alone_go_to_the_detector(run, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("IMOCAP_DETECT_PYTHON", str(tmp_path / "nowhere"))
    clips = [_video(tmp_path / f"{name}.mp4", 3) for name in ("a", "b")]
    assert run(*clips) == 1
    shown = capsys.readouterr()
    assert "IMOCAP_DETECT_PYTHON: the program" in shown.err
    assert shown.err.count("\n") == 1


def test_keypoints_that_are_not_understood(run, tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "f0.json").write_text('{"people": [{"pose_keypoints_2d": [1, 2, 3]}]}')
    assert run(tmp_path / "a", *FORMAT) == 1
    message = capsys.readouterr().err
    assert "points per person, got 1" in message
    assert message.count("\n") == 1


def test_keypoints_are_found_where_people_put_them(made: Made, tmp_path: Path) -> None:
    for n, place in enumerate(("c", "c_keypoints", "c_json", "keypoints/c", "../keypoints/c")):
        clip = tmp_path / str(n) / "videos" / "c.mp4"
        clip.parent.mkdir(parents=True)
        clip.write_bytes(b"")
        folder = made.write_openpose(clip.parent / place, 0, frames=1)
        (source,) = sources_of([str(clip)])
        assert source.keypoints.resolve() == folder.resolve()
        assert labels([source]) == ["c"]
    (bare,) = sources_of([str(_video(tmp_path / "d.mp4", 1))])
    assert bare.keypoints is None  # people will be found in it
    for n, place in enumerate(("e_keypoints.json", "keypoints/e.csv", "e_keypoints.npz")):
        clip = _video(tmp_path / "files" / str(n) / "e.mp4", 1)
        file = clip.parent / place
        file.parent.mkdir(exist_ok=True)
        file.write_text("")
        assert sources_of([str(clip)])[0].keypoints == file


def test_files_of_other_detectors_are_synchronised(run, made: Made, tmp_path: Path) -> None:
    files = []
    for v, write in enumerate((made_keypoints.write_alphapose, made_keypoints.write_mmpose)):
        video, columns = made.keypoints.videos[v], list(made.model.points("body25").columns)
        people = {}
        for n, xy in enumerate(video.xy_px):
            person = np.zeros((25, 3))
            person[columns] = np.column_stack([xy, np.full(len(xy), 0.9)])
            people[n] = [person]
        files.append(write(tmp_path, people))
    out = tmp_path / "out"
    assert run(*files, *FORMAT, *QUICK, "--out", out, "--name", "files") == 0
    videos = read_action(tmp_path / "artifacts" / "files").videos
    assert [(v.format, v.layout) for v in videos] == [("alphapose", "body25"), ("mmpose", "body25")]
    assert len(_rows(out / "sync.csv")) == 24


def test_a_clip_without_repetitions_is_not_cut(run, made, tmp_path, capsys):
    clip = made.write_openpose(tmp_path / "in" / "long", 0)
    assert run(clip, *FORMAT, *QUICK, "--repetitions") == 1
    message = capsys.readouterr().err
    assert "long: no repetitions: " in message
    assert message.count("\n") == 1


def test_repetitions_enter_as_videos_of_the_same_file(run, made, tmp_path, capsys, monkeypatch):
    """The cut itself is tested in tests/sync; here, what is made of it."""
    repetitions = Repetitions(((0, 11), (11, 23)), 0.9, "2 repetitions")
    monkeypatch.setattr(
        "imocap_core.sync.repetition.find_repetitions", lambda *_, **__: repetitions
    )
    clip = _video(tmp_path / "in" / "long.mp4", 24)
    made.write_openpose(tmp_path / "in" / "long", 0)
    assert run(clip, *QUICK, "--repetitions", "--name", "try") == 0
    assert "long: 2 repetitions" in capsys.readouterr().out
    folder = tmp_path / "artifacts" / "try-repetitions"
    videos = read_action(folder).videos
    assert [(v.id, v.frames) for v in videos] == [("long_r1", (0, 11)), ("long_r2", (11, 23))]
    assert {(folder / str(v.video)).resolve() for v in videos} == {clip.resolve()}
    assert (folder / "sync" / "side_by_side.mp4").is_file()
    (reference,) = {"long_r1", "long_r2"} - {r["video"] for r in _rows(folder / "sync/sync.csv")}
    other = "long_r2" if reference == "long_r1" else "long_r1"
    frames = [int(row["frame"]) for row in _rows(folder / "sync" / "sync.csv")]
    assert frames == list(range(*next(v.frames for v in videos if v.id == other and v.frames)))


def test_a_declared_long_clip_is_cut_and_the_other_videos_stay(
    run, made, tmp_path, capsys, monkeypatch
):
    repetitions = Repetitions(((0, 11), (11, 23)), 0.9, "2 repetitions")
    monkeypatch.setattr(
        "imocap_core.sync.repetition.find_repetitions", lambda *_, **__: repetitions
    )
    for name in ("long", "other"):
        made.write_openpose(tmp_path / "in" / name, 0)
    declared = {"format": "openpose", "layout": "body25", "fps": 30.0, "size": [640, 360]}
    action = {
        "name": "serves",
        "videos": [
            {"id": "long", "keypoints": "../in/long", "repetitions": True, **declared},
            {"id": "other", "keypoints": "../in/other", **declared},
        ],
        "params": {"sync": {"rounds": 1}},
    }
    folder = tmp_path / "serves"
    folder.mkdir()
    (folder / "action.yaml").write_text(yaml.safe_dump(action))
    assert run(folder, *QUICK) == 0
    assert "long: 2 repetitions" in capsys.readouterr().out
    parts = read_action(tmp_path / "artifacts" / "serves-repetitions")
    assert [(v.id, v.frames) for v in parts.videos] == [
        ("long_r1", (0, 11)),
        ("long_r2", (11, 23)),
        ("other", None),
    ]
    assert parts.params == {"sync": {"rounds": 1}}
    (folder / "action.yaml").write_text(
        yaml.safe_dump(action | {"forbidden": [{"video": "other", "frames": [0, 2]}]})
    )
    assert run(folder, *QUICK) == 1
    assert "anchors and forbidden spans refer to whole videos" in capsys.readouterr().err


def test_sizes_are_read() -> None:
    assert read_size("1920x1080") == (1920, 1080)
    assert read_size(None) is None
    with pytest.raises(WrongUse):
        read_size("0x5")

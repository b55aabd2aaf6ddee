"""`imocap list`: the actions of a working folder, their state, their results."""

import http.client
import json
import os
import signal
import threading
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from imocap_core.artifacts.file_memory import exclusive
from imocap_core.cli import main
from imocap_core.cli.action_commands import size_text
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.io.video import write_h264
from imocap_core.library import cleaning
from imocap_core.library.cleaning import bytes_of, clean
from imocap_core.library.people import VideoPeople, people_of
from imocap_core.library.status import headline_of
from imocap_core.pipeline.action import Action, Declaration
from tests.made_keypoints import write_walk
from tests.pick.conftest import picture
from tests.pipeline.conftest import Toy
from tests.stages.test_people import PARAMS

Capture = pytest.CaptureFixture[str]


def listed(toy: Toy, capsys: Capture) -> dict[str, dict]:
    capsys.readouterr()
    assert toy.imocap(["list", "--json"]) == 0
    return {row["name"]: row for row in json.loads(capsys.readouterr().out)["actions"]}


def test_the_state_of_an_action_follows_its_runs(toy: Toy, capsys: Capture) -> None:
    assert listed(toy, capsys)["toy"]["state"] == "not run"
    toy.imocap(["run", "toy"])
    row = listed(toy, capsys)["toy"]
    assert (row["state"], row["videos"], row["stages"], row["cached"]) == ("cached", 2, 3, 3)
    (toy.action / "v1.txt").write_text("9")
    row = listed(toy, capsys)["toy"]
    assert (row["state"], row["cached"]) == ("partly cached", 0)


def test_built_in_and_invalid_actions_are_listed_too(toy: Toy, capsys: Capture) -> None:
    broken = toy.root / "actions" / "broken"
    broken.mkdir()
    (broken / "action.yaml").write_text("name: broken\nvideos: 3\n")
    rows = listed(toy, capsys)
    assert list(rows) == ["broken", "taichi", "toy", "yoga"]
    assert rows["yoga"]["state"] == "not made"
    assert rows["broken"]["state"] == "invalid"
    assert "videos" in rows["broken"]["fault"]


def test_the_table_has_a_line_for_each_action(toy: Toy, capsys: Capture) -> None:
    toy.imocap(["run", "toy"])
    report = toy.root / "artifacts" / "toy" / "report"
    (report / "summary.csv").write_text("result,reprojection_px\nafter loop,8.7\n")
    capsys.readouterr()
    assert toy.imocap(["list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    (row,) = (line.split() for line in lines if line.startswith("toy"))
    assert row == ["toy", "2", "cached", "reprojection", "8.7", "px"]
    assert "built in, not made yet" in "\n".join(lines)


def test_the_headline_is_of_the_last_result_and_of_what_was_scored(tmp_path: Path) -> None:
    file = tmp_path / "summary.csv"
    assert headline_of(file) == ""
    file.write_text("result,mpjpe_scaled_mm,sync_error_pct,reprojection_px\n")
    assert headline_of(file) == ""
    file.write_text(
        "result,mpjpe_scaled_mm,sync_error_pct,matched_share,reprojection_px\n"
        "monocular,90,,,7\nafter loop,45.36,0.556,1.0,8.72\n"
    )
    assert headline_of(file) == "scaled MPJPE 45.4 mm, sync error 0.56 %, matched 100%"
    file.write_text("result,mpjpe_scaled_mm,matched_share,reprojection_px\nafter loop,,0.9,nan\n")
    assert headline_of(file) == "matched 90%"


def declared(folder: Path, name: str, **changes: Any) -> Declaration:
    write_walk(folder / name)
    fields = {
        "id": name, "keypoints": name, "format": "openpose", "layout": "body25",
        "fps": 30.0, "size": (640, 360), "frames": (4, 20),
    }  # fmt: skip
    return Declaration(**(fields | changes))


def people(folder: Path, **changes: Any) -> list[VideoPeople]:
    action = Action(folder, "made", (declared(folder, "v1", **changes),))
    return people_of(action, PARAMS)


def test_everybody_is_listed_the_performer_first(tmp_path: Path) -> None:
    (video,) = people(tmp_path)
    first, second = video.tracks
    assert (first.number, second.number) == (1, 2)
    assert (first.first_frame, first.last_frame) == (4, 19)
    assert first.score == 1
    assert second.score < 1
    assert first.box_frame == 12
    assert "2 people followed" in video.notes[0]


def test_a_name_from_the_list_is_taken(tmp_path: Path) -> None:
    (video,) = people(tmp_path, person={"track": 2})
    assert "track 2 is the performer as action.yaml declares" in video.notes[0]


def test_a_wrong_person_is_named_beside_everybody_there_is(tmp_path: Path) -> None:
    (video,) = people(tmp_path, person={"track": 5})
    assert [track.number for track in video.tracks] == [1, 2]
    assert "videos.v1.person: track: expected 1 to 2, got 5" in str(video.fault)


def test_one_bad_video_is_named_and_the_others_are_listed(tmp_path: Path) -> None:
    good = declared(tmp_path, "v1")
    bad = (
        declared(tmp_path, "small", size=(6400, 3600)),
        declared(tmp_path, "short", frames=(4, 90)),
        declared(tmp_path, "gone", keypoints="elsewhere"),
    )
    videos = people_of(Action(tmp_path, "made", (good, *bad)), PARAMS)
    assert [(video.id, len(video.tracks)) for video in videos] == [
        ("v1", 2), ("small", 2), ("short", 0), ("gone", 0)
    ]  # fmt: skip
    assert videos[0] == people_of(Action(tmp_path, "made", (good,)), PARAMS)[0]
    expected = ("6400 x 3600", "videos.short.frames", "elsewhere")
    for video, words in zip(videos[1:], expected, strict=True):
        assert words in str(video.fault)
    with pytest.raises(WorkFailed, match="elsewhere"):
        people_of(Action(tmp_path, "made", bad[2:]), PARAMS)


def end(address: str, by_signal: bool) -> None:
    """As somebody does who presses Done, or Ctrl-C while the page is there."""
    parts = urlsplit(address)
    connection = http.client.HTTPConnection(parts.netloc, timeout=30)
    headers = {"Origin": f"http://{parts.netloc}", "Content-Type": "application/json"}
    words = ("GET", parts.path) if by_signal else ("POST", f"{parts.path}done", "{}", headers)
    connection.request(*words)
    assert connection.getresponse().status == 200
    connection.close()
    if by_signal:
        os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.parametrize("by_signal", [False, True])
def test_a_new_action_is_served_until_done_or_ctrl_c(tmp_path, capsys, monkeypatch, by_signal):
    videos = [tmp_path / f"{name}.mp4" for name in ("a", "b")]
    for video in videos:
        write_h264(video, [picture(t, 0, False) for t in range(5)], 20.0)
    opened: list[str] = []

    def open_in_browser(address: str) -> bool:
        opened.append(address)
        threading.Thread(target=end, args=(address, by_signal)).start()
        return True

    monkeypatch.setattr("webbrowser.open", open_in_browser)
    monkeypatch.setenv("BROWSER", "one")
    code = main(["--root", str(tmp_path), "pick", "made", *map(str, videos)])
    shown = capsys.readouterr()
    assert code == 0, shown.err
    assert f"Pick at {opened[0]}" in shown.out
    assert opened[0].startswith("http://127.0.0.1:")
    assert shown.out.rstrip().endswith("Next: imocap run made")
    assert (tmp_path / "actions" / "made" / "action.yaml").is_file()


def test_an_action_that_does_not_exist_is_a_sentence(tmp_path, capsys):
    assert main(["--root", str(tmp_path), "pick", "nowhere", "--no-open"]) == 2
    assert "no action 'nowhere'" in capsys.readouterr().err


@pytest.fixture
def used(toy: Toy) -> Toy:
    """Two runs of the toy: the results of the first are no longer current, but for `gather`."""
    assert toy.imocap(["run", "toy"]) == 0
    assert toy.imocap(["run", "toy", "--set", "sync.method=als"]) == 0
    return toy


def results(toy: Toy) -> list[str]:
    files = (toy.root / "artifacts" / ".cache").glob("*/*.mcap")
    return sorted(file.parent.name for file in files)


def test_without_options_only_leftovers_go(used: Toy, capsys: Capture) -> None:
    leftover = used.root / "artifacts" / "toy" / ".scale.mcap.12.part"
    leftover.write_bytes(b"half")
    before = results(used)
    capsys.readouterr()
    assert used.imocap(["clean"]) == 0
    shown = capsys.readouterr().out
    assert "Removed 0 results (0 B) and 1 leftover (4 B)." in shown
    assert "give --older DAYS or --max-size SIZE" in shown
    assert not leftover.exists()
    assert results(used) == before


def test_old_results_go_and_current_ones_stay(used: Toy, capsys: Capture) -> None:
    digests = used.digests()
    assert results(used) == ["evaluate", "evaluate", "gather", "scale", "scale"]
    assert used.imocap(["clean", "--older", "1"]) == 0
    assert len(results(used)) == 5  # all were used today
    assert used.imocap(["clean", "--older", "0", "--dry-run"]) == 0
    assert len(results(used)) == 5
    assert "Would remove 2 results" in capsys.readouterr().out
    assert used.imocap(["clean", "--older", "0"]) == 0
    shown = capsys.readouterr().out
    assert "Removed 2 results" in shown
    assert [row.split()[0] for row in shown.splitlines()[1:4]] == ["evaluate", "gather", "scale"]
    assert results(used) == ["evaluate", "gather", "scale"]
    assert used.digests() == digests
    used.ran()
    assert used.imocap(["run", "toy", "--set", "sync.method=als"]) == 0
    assert used.ran() == []
    assert used.imocap(["run", "toy"]) == 0  # what was removed is made again
    assert used.ran() == ["scale", "evaluate"]


def test_results_go_until_the_cache_fits_the_oldest_first(used: Toy, capsys: Capture) -> None:
    files = sorted((used.root / "artifacts" / ".cache").glob("*/*.mcap"))
    total = sum(file.stat().st_size for file in files)
    old = clean(older_days=0.0, dry_run=True, root=used.root)
    (oldest,) = (f for f in files if f.parent.name == "scale" and f.stat().st_nlink == 1)
    os.utime(oldest, (0.0, 0.0))
    assert used.imocap(["clean", "--max-size", f"{total - 1}B"]) == 0
    assert not oldest.exists()
    assert len(results(used)) == 4
    capsys.readouterr()
    assert used.imocap(["clean", "--max-size", "0"]) == 0
    assert len(results(used)) == 3
    stay = size_text(total - old.removed_bytes)
    assert f"The results that must stay take {stay}." in capsys.readouterr().out


def test_nothing_is_removed_while_a_run_is_in_progress(used: Toy, capsys: Capture) -> None:
    with exclusive(used.root / "artifacts" / "toy" / ".lock", lambda: None):
        assert used.imocap(["clean", "--older", "0"]) == 1
    assert "a run of toy is in progress" in capsys.readouterr().err
    assert len(results(used)) == 5


def test_detections_of_an_action_that_cannot_be_read_stay(used: Toy) -> None:
    folder = used.root / "artifacts" / ".cache" / "detections"
    folder.mkdir()
    (folder / "a.npz").write_bytes(b"x")
    clean(older_days=0.0, dry_run=True, root=used.root)
    (used.action / "action.yaml").write_text("videos: 3")
    clean(older_days=0.0, root=used.root)
    assert (folder / "a.npz").exists()
    (used.action / "action.yaml").unlink()
    clean(older_days=0.0, root=used.root)
    assert not (folder / "a.npz").exists()


def test_an_empty_folder_has_nothing_to_clean(tmp_path: Path, toy: Toy, capsys: Capture) -> None:
    assert toy.imocap(["clean", "--older", "0"]) == 0
    assert "Removed 0 results (0 B) and 0 leftovers (0 B)." in capsys.readouterr().out


def test_sizes() -> None:
    assert [bytes_of(t) for t in ("10", "2GB", "1.5 kb", "3 MB")] == [
        10,
        2 * 10**9,
        1500,
        3 * 10**6,
    ]
    assert [size_text(n) for n in (0, 999, 1500, 2 * 10**9)] == ["0 B", "999 B", "1.5 kB", "2.0 GB"]
    with pytest.raises(WrongUse, match="invalid size 'much'"):
        bytes_of("much")


def test_without_a_limit_nothing_is_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMOCAP_CACHE_LIMIT", "0")
    monkeypatch.setattr(cleaning, "cached_results", lambda folder: pytest.fail("looked"))
    assert cleaning.keep_cache_within_limit(Path("no such folder")) == []


def test_a_run_keeps_the_cache_within_its_limit(used, capsys, monkeypatch):
    monkeypatch.setenv("IMOCAP_CACHE_LIMIT", "0")
    assert used.imocap(["run", "toy"]) == 0
    every = len(list((used.root / "artifacts" / ".cache").glob("*/*.mcap")))
    monkeypatch.setenv("IMOCAP_CACHE_LIMIT", "1 B")
    assert used.imocap(["run", "toy"]) == 0
    assert "(IMOCAP_CACHE_LIMIT)" in capsys.readouterr().out
    remaining = list((used.root / "artifacts" / ".cache").glob("*/*.mcap"))
    assert 3 <= len(remaining) < every
    assert used.imocap(["run", "toy"]) == 0
    assert "all cached" in capsys.readouterr().out
    monkeypatch.setenv("IMOCAP_CACHE_LIMIT", "much")
    assert used.imocap(["run", "toy"]) == 2
    assert "IMOCAP_CACHE_LIMIT: invalid size" in capsys.readouterr().err

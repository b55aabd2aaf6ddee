"""Exit codes and sentences: 0 done, 1 the work failed, 2 wrong use; never a traceback. Commands and
parameters are listed with what they mean."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any, get_args

import pytest
import typer

from imocap_core.cli import hoisted
from imocap_core.cli.app import app, command_line
from imocap_core.export.formats import WRITERS
from imocap_core.io.readers.keypoint_readers import FORMATS
from imocap_core.library.new_action import action_of_words
from imocap_core.params import Params
from imocap_core.pipeline.action import read_action
from imocap_core.pipeline.format_names import InitialFormat
from imocap_core.pipeline.source import PROJECT
from imocap_core.sync_sources import ascii_name
from tests.io.made_videos import write_video
from tests.pipeline.conftest import Toy

Capture = pytest.CaptureFixture[str]


@pytest.mark.parametrize(
    ("code", "words", "message"),
    [
        (2, ["frob"], "No such command 'frob'"),
        (2, ["run"], "Missing argument"),
        (2, ["run", "nobody"], "no action 'nobody'"),
        (2, ["stage", "dance", "toy"], "no stage 'dance'; there are: gather, scale, evaluate"),
        (2, ["explain", "toy", "dance"], "no stage 'dance'"),
        (2, ["run", "toy", "--set", "sync.method=magic"], "sync.method: expected 'als'"),
        (2, ["run", "toy", "--set", "sync.magic=1"], "--set: sync.magic: unknown parameter"),
        (2, ["run", "yoga", "--set", "sync.magic=1"], "--set: sync.magic: unknown parameter"),
        (2, ["run", "toy", "--set", "magic.x=1"], "--set: magic: unknown group of parameters"),
        (2, ["run", "toy", "--set", "sync.method"], "expected group.name=value"),
        (2, ["run", "toy", "--set", "seed=-1"], "expected a whole number from 0 up, got -1"),
        (2, ["export", "toy", "--format", "dae", "--out", "x"], "'dae'"),
        (2, ["init", "a/b", "x.mp4"], "invalid action name 'a/b'"),
        (2, ["init", "mine", "x.mp4"], "there is no video x.mp4"),
        (
            2,
            ["clean", "--max-size", "two"],
            "invalid size 'two': expected a number with KB, MB, GB",
        ),
        (2, ["clean", "--older", "-1"], "--older"),
        (2, ["clean", "--older", "soon"], "--older"),
        (1, ["view", "toy"], "toy has no report yet; make one with: imocap run toy"),
        (1, ["export", "toy", "--out", "x"], "toy has no keypoints artifact yet; run it with"),
    ],
)
def test_wrong_use_and_work_that_can_t_be_done(
    toy: Toy, capsys: Capture, code: int, words: list[str], message: str
) -> None:
    assert toy.imocap(words) == code
    shown = capsys.readouterr().err
    assert message in shown
    assert "Traceback" not in shown


def test_a_folder_that_can_t_be_used_is_named(toy: Toy, capsys: Capture) -> None:
    (toy.root / "artifacts").write_text("a file where a folder should be")
    assert toy.imocap(["run", "toy"]) == 1
    message = capsys.readouterr().err
    assert f"cannot use {toy.root / 'artifacts'}" in message
    assert "fault of the program" not in message


def test_a_built_in_action_that_is_not_made_yet(toy: Toy, capsys: Capture) -> None:
    assert toy.imocap(["status", "yoga"]) == 1
    assert "yoga is built in but not made yet; make it: imocap run yoga" in capsys.readouterr().err


def test_init_then_run_says_what_is_missing(toy: Toy, capsys: Capture, tmp_path: Path) -> None:
    clips = [tmp_path / "a clip.mp4", tmp_path / "b.mp4"]
    for clip in clips:
        write_video(clip)
    assert toy.imocap(["init", "mine", *map(str, clips)]) == 0
    action = read_action(toy.root / "actions" / "mine")
    assert [v.id for v in action.videos] == ["a_clip", "b"]
    assert (action.folder / str(action.videos[0].video)).resolve() == clips[0].resolve()
    for clip in clips:
        clip.write_bytes(b"")
    capsys.readouterr()
    assert toy.imocap(["run", "mine"]) == 1
    message = capsys.readouterr().err
    assert f"{clips[0].resolve()}: expected a video, got an empty file" in message
    assert "fault of the program" not in message
    assert message.count("\n") == 2  # a line for each of the two
    assert toy.imocap(["init", "mine", str(clips[0])]) == 2
    assert "exists already" in capsys.readouterr().err


def test_a_full_disk_leaves_no_declaration(toy, tmp_path, monkeypatch, capsys):
    clip, folder = write_video(tmp_path / "a.mp4"), toy.root / "actions" / "mine"
    elsewhere = tmp_path / "elsewhere"
    folder.mkdir(parents=True)
    (folder / "action.yaml").symlink_to(elsewhere)  # a link that somebody left there

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "no room")

    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", full)
        assert toy.imocap(["init", "mine", str(clip)]) == 1
    assert "the disk is full" in capsys.readouterr().err
    assert [path.name for path in folder.iterdir()] == ["action.yaml"]
    assert not (folder / "action.yaml").exists()
    assert toy.imocap(["init", "mine", str(clip)]) == 0
    assert read_action(folder).videos[0].id == "a"
    assert not elsewhere.exists()


def test_videos_of_one_name_get_numbers(toy: Toy, tmp_path: Path) -> None:
    clips = [tmp_path / folder / "clip.mp4" for folder in ("x", "y")]
    for clip in clips:
        clip.parent.mkdir()
        write_video(clip)
    assert toy.imocap(["init", "mine", *map(str, clips)]) == 0
    action = read_action(toy.root / "actions" / "mine")
    assert [v.id for v in action.videos] == ["v1", "v2"]


def test_names_in_other_scripts_and_with_spaces(toy: Toy, capsys: Capture, tmp_path: Path) -> None:
    """Ids are plain; which video is which file is said. What `init` was given, `run` takes too."""
    names = [ascii_name(n) for n in ("Élan 2", "深蹲", "深蹲 1", "приседание", "__", "a-b.c")]
    assert names == ["Elan_2", "", "", "", "", "a-b.c"]
    folder = tmp_path / "clips"
    (folder / "side").mkdir(parents=True)
    write_video(folder / "深蹲.mp4")
    write_video(folder / "side" / "serve.mp4")
    assert toy.imocap(["init", "my serve", str(folder)]) == 0
    shown = capsys.readouterr().out
    assert "v1 is serve.mp4, v2 is 深蹲.mp4" in shown
    assert "of 2 videos. Next: imocap run my_serve." in shown
    assert [v.id for v in read_action(toy.root / "actions" / "my_serve").videos] == ["v1", "v2"]
    assert action_of_words(toy.root, ["my serve"], None) == ("my_serve", [])
    assert toy.imocap(["init", "深蹲", str(folder)]) == 2
    assert "letters from A to Z" in capsys.readouterr().err


def test_a_terminal_without_the_characters_gets_others(toy: Toy, tmp_path: Path) -> None:
    clip = write_video(tmp_path / "深蹲.mp4")
    words = ["--root", str(toy.root), "init", "squat", str(clip)]
    done = subprocess.run(
        [sys.executable, "-c", "from imocap_core.cli import main; main()", *words],
        env=os.environ | {"PYTHONIOENCODING": "cp1252", "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        check=True,
    )
    assert b"v1 is ??.mp4" in done.stdout
    assert done.stderr == b""


def test_many_files_that_are_no_videos_take_one_line(toy, capsys, tmp_path):
    folder = tmp_path / "clips"
    folder.mkdir()
    write_video(folder / "a.mp4")
    (folder / "broken.mp4").write_bytes(b"nothing")
    for n in range(5):
        (folder / f"{n}.txt").write_text("hello")
    assert toy.imocap(["init", "mine", str(folder)]) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if "left out" in line]
    assert len(lines) == 2
    assert "broken.mp4: expected a video" in lines[0]
    assert lines[1] == "left out, as no videos: 0.txt, 1.txt, 2.txt and 2 more"


def test_formats_are_listed(toy: Toy, capsys: Capture) -> None:
    assert toy.imocap(["formats"]) == 0
    shown = capsys.readouterr().out
    for name in (*FORMATS, *get_args(InitialFormat), *WRITERS):
        lines = [row for row in shown.splitlines() if row.split()[:1] == [name]]
        assert lines, name
        assert all(len(line.split()) > 3 for line in lines), name
    assert toy.imocap(["formats", "export", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)["formats"]
    assert [each["name"] for each in listed] == list(WRITERS)
    assert toy.imocap(["formats", "films"]) == 2


def test_init_names_every_file_that_is_no_video(toy: Toy, capsys: Capture, tmp_path: Path) -> None:
    text, one = tmp_path / "notes.txt", write_video(tmp_path / "one.mp4", count=1)
    text.write_text("hello")
    clip = write_video(tmp_path / "a.mp4")
    assert toy.imocap(["init", "mine", str(clip), str(text), str(one)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert any(f"{text}: expected a video, got text" in line for line in lines)
    assert any(f"{one}: expected at least 3 frames" in line for line in lines)
    assert not (toy.root / "actions" / "mine").exists()


def test_a_folder_of_videos_becomes_an_action(toy: Toy, capsys: Capture, tmp_path: Path) -> None:
    folder = tmp_path / "My jumps"
    folder.mkdir()
    for name in ("jump10.mp4", "jump2.mp4"):
        write_video(folder / name)
    (folder / "notes.txt").write_text("hello")
    (folder / ".hidden").write_text("hello")
    assert toy.imocap(["init", "mine", str(folder)]) == 0
    shown = capsys.readouterr().out
    assert f"left out: {folder / 'notes.txt'}: expected a video, got text" in shown
    assert ".hidden" not in shown
    action = read_action(toy.root / "actions" / "mine")
    assert [v.id for v in action.videos] == ["jump2", "jump10"]
    (tmp_path / "empty").mkdir()
    assert toy.imocap(["init", "other", str(tmp_path / "empty")]) == 2
    assert "expected videos in the folder, got none" in capsys.readouterr().err


def test_run_makes_the_action_of_videos(toy: Toy, capsys: Capture, tmp_path: Path) -> None:
    folder = tmp_path / "My jumps"
    folder.mkdir()
    clips = [str(write_video(folder / f"jump{n}.mp4")) for n in range(2)]
    for _ in range(2):  # made once, then used again
        assert action_of_words(toy.root, [str(folder)], None)[0] == "My_jumps"
    assert len(read_action(toy.root / "actions" / "My_jumps").videos) == 2
    name, remarks = action_of_words(toy.root, clips, None)
    assert name.startswith("jump-")
    assert "Wrote" in remarks[0]
    assert action_of_words(toy.root, clips, None) == (name, [])
    assert action_of_words(toy.root, clips, "mine")[0] == "mine"
    for word in ("toy", "nobody", str(toy.root / "actions" / "mine")):
        assert action_of_words(toy.root, [word], None) == (word, [])
    assert toy.imocap(["run", "toy", *clips]) == 2
    assert "toy is an action: give it alone" in capsys.readouterr().err
    assert toy.imocap(["run", "--name", "mine", clips[0]]) == 2
    assert "action.yaml is of other videos" in capsys.readouterr().err


def test_status_says_what_would_run_and_why(toy: Toy, capsys: Capture) -> None:
    assert toy.imocap(["status", "toy"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split() for line in lines] == [
        ["gather", "would", "run", "never", "run"],
        ["scale", "would", "run", "after", "gather"],
        ["evaluate", "would", "run", "after", "gather,", "scale"],
    ]
    toy.imocap(["run", "toy"])
    (toy.action / "v1.txt").write_text("9")
    capsys.readouterr()
    toy.imocap(["status", "toy"])
    assert "read: detections v1 has changed" in capsys.readouterr().out
    (toy.action / "v1.txt").write_text("1.5")
    toy.imocap(["status", "toy", "--set", "sync.method=als"])
    message = capsys.readouterr().out
    assert "gather         cached" in message
    assert "sync.method: softmap -> als" in message


def test_explain_lists_what_a_stage_depends_on(toy: Toy, capsys: Capture) -> None:
    toy.imocap(["run", "toy"])
    capsys.readouterr()
    assert toy.imocap(["explain", "toy", "scale"]) == 0
    message = capsys.readouterr().out
    for part in ("scale: cached", "gather", "scale.py", "sync.method = softmap", "schemas.base"):
        assert part in message
    script = toy.root / "toys" / "scale.py"
    script.write_text(script.read_text().replace("2.0", "3.0"))
    toy.imocap(["explain", "toy", "scale"])
    assert "because code: scale.py has changed" in capsys.readouterr().out


def test_an_action_s_own_parameters_hold(toy: Toy, capsys: Capture) -> None:
    file = toy.action / "action.yaml"
    plain = file.read_text()
    file.write_text(plain + "params: {sync: {method: als}}\n")
    assert toy.imocap(["explain", "toy", "scale"]) == 0
    assert toy.imocap(["run", "toy"]) == 0
    capsys.readouterr()
    toy.imocap(["explain", "toy", "scale"])
    assert "sync.method = als" in capsys.readouterr().out
    file.write_text(plain + "params: {sync: {metod: als}}\n")
    assert toy.imocap(["run", "toy"]) == 1
    assert "sync.metod: unknown parameter; expected one of " in capsys.readouterr().err


def test_root_may_stand_anywhere() -> None:
    assert hoisted(["run", "yoga", "--root", "x", "--force"]) == (
        ["--root", "x"],
        ["run", "yoga", "--force"],
    )
    assert hoisted(["run", "yoga", "--root=x"]) == (["--root=x"], ["run", "yoga"])
    assert hoisted(["run", "--", "--root"]) == ([], ["run", "--", "--root"])
    assert hoisted(["run", "yoga", "--root"]) == (["--root"], ["run", "yoga"])


def test_doctor_fits_one_screen(toy, capsys):
    assert toy.imocap(["doctor"]) == 0
    message = capsys.readouterr().out
    assert "body model: free_body" in message
    assert "detection: " in message
    rows = sum(-(-len(line) // 80) for line in message.splitlines())
    assert rows <= 24  # one screen


def test_a_group_lists_its_parameters_and_no_others(toy: Toy, capsys: Capture) -> None:
    assert toy.imocap(["params", "sync"]) == 0
    heads = [line for line in capsys.readouterr().out.splitlines() if not line.startswith(" ")]
    names = [head.split(" = ")[0] for head in heads]
    assert names == [f"sync.{field.name}" for field in fields(Params().sync)]
    (method,) = (head for head in heads if head.startswith("sync.method = "))
    assert "als" in method
    assert "svt" in method


def test_values_of_pipeline_yaml_stand_beside_their_defaults(toy: Toy, capsys: Capture) -> None:
    default = Params().sync.max_rate
    file = toy.root / "pipeline.yaml"
    file.write_text(file.read_text().replace("method: softmap", "max_rate: 12.5"))
    assert toy.imocap(["params", "sync"]) == 0
    lines = capsys.readouterr().out.splitlines()
    (line,) = (line for line in lines if line.startswith("sync.max_rate = "))
    assert line.startswith("sync.max_rate = 12.5  (")
    assert line.endswith(f"default {default})")


def test_all_parameters_as_json(toy: Toy, capsys: Capture) -> None:
    assert toy.imocap(["params", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["parameters"]
    assert {row["group"] for row in rows} == {field.name for field in fields(Params)}
    assert all(row["doc"] and row["bounds"] for row in rows)


def test_an_unknown_group_is_refused(toy: Toy, capsys: Capture) -> None:
    assert toy.imocap(["params", "magic"]) == 2
    assert "no group of parameters 'magic' (the groups are: detect" in capsys.readouterr().err


ORDER = (
    *("init", "collect"),
    *("pick", "run", "run-all", "view", "export", "angles", "video", "report", "compare"),
    "sync",
    *("status", "list"),
    *("explain", "stage", "detect", "people", "params", "formats", "clean"),
    *("benchmark", "doctor"),
)
HEAVY = ("numpy", "pydantic", "scipy", "torch", "rich.table", "yaml", "imocap_core.library")


def commands() -> dict[str, Any]:
    group = typer.main.get_command(app)
    return dict(group.commands)  # type: ignore[attr-defined]


def test_commands_are_listed_in_the_order_in_which_people_need_them(toy, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert tuple(commands()) == ORDER
    assert toy.imocap(["-h"]) == 0
    lines = capsys.readouterr().out.splitlines()
    listed = lines[lines.index("Commands:") + 1 :]
    assert [line.split()[0] for line in listed] == list(ORDER)
    assert not [line for line in listed if line.endswith("...")]  # no summary is cut


@pytest.mark.parametrize("command", ORDER)
@pytest.mark.parametrize("option", ["-h", "--help"])
def test_every_command_has_help(toy: Toy, capsys: Capture, command: str, option: str) -> None:
    assert toy.imocap([command, option]) == 0
    assert f"Usage: imocap {command}" in capsys.readouterr().out


def test_the_version_is_the_package_s(toy: Toy, capsys: Capture) -> None:
    citation = (PROJECT / "CITATION.cff").read_text()
    assert toy.imocap(["--version"]) == 0
    version = capsys.readouterr().out.removeprefix("imocap ").strip()
    assert f"\nversion: {version}\n" in citation


def test_the_command_line_imports_nothing_heavy() -> None:
    code = (
        "import sys; from imocap_core.cli.app import app; import typer; "
        "typer.main.get_command(app); "
        f"print([name for name in {HEAVY} if name in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=PROJECT, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


def test_the_shell_completes_commands_actions_stages_and_groups(toy, capsys, monkeypatch):
    monkeypatch.setenv("_IMOCAP_COMPLETE", "complete_bash")
    for line, offered in (
        ("imocap st", ["status", "stage"]),
        (f"imocap --root {toy.root} run t", ["taichi", "toy"]),
        (f"imocap --root {toy.root} stage s", ["scale"]),
        ("imocap params sy", ["sync"]),
        ("imocap export toy --format b", ["bvh"]),
    ):
        monkeypatch.setenv("COMP_WORDS", line)
        monkeypatch.setenv("COMP_CWORD", str(len(line.split(" ")) - 1))
        toy.imocap([])
        assert capsys.readouterr().out.split() == offered


def test_completion_can_be_installed(toy: Toy, capsys: Capture) -> None:
    assert toy.imocap(["-h"]) == 0
    shown = capsys.readouterr().out
    assert "--install-completion" in shown
    assert "--show-completion" in shown


def test_the_page_of_commands_has_every_command_with_its_summary() -> None:
    page = (PROJECT / "docs" / "commands.md").read_text(encoding="utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| `imocap ")]
    summaries = {name: (c.help or "").partition("\n\n")[0] for name, c in commands().items()}
    assert rows == [f"| `imocap {name}` | {text} |" for name, text in summaries.items()]


@pytest.mark.parametrize("word", ORDER)
def test_a_command_reads_its_own_options_alone(word: str) -> None:
    assert list(command_line(word).commands) == [word]


@pytest.mark.parametrize(
    ("words", "first"),
    [
        (["--root", "run", "--traceback", "status"], "status"),
        (["--root=run", "status", "run"], "status"),
        (["--help", "status"], "--help"),
        (["--", "status"], "--"),
    ],
)
def test_the_first_word_beside_options_of_all_commands(words: list[str], first: str) -> None:
    assert hoisted(words)[1][0] == first


def test_unknown_words_know_all_commands() -> None:
    every = list(command_line(None).commands)
    assert len(every) > 20
    assert list(command_line("nonsense").commands) == every

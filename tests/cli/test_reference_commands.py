"""`imocap params`: every parameter with its value, unit, bounds and meaning."""

import json
import subprocess
import sys
from dataclasses import fields
from typing import Any

import pytest
import typer

from imocap_core.cli import hoisted
from imocap_core.cli.app import app, command_line
from imocap_core.params import Params
from imocap_core.pipeline.source import PROJECT
from tests.pipeline.conftest import Toy

Capture = pytest.CaptureFixture[str]


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

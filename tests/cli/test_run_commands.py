"""Every run leaves a record for programs; its lines and documents, and the device it runs on."""

import io
import json
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from rich.console import Console

from imocap_core import process
from imocap_core.artifacts.codec import Content
from imocap_core.artifacts.store import stored_as
from imocap_core.cli.options import counted, plain, shortened
from imocap_core.cli.run_commands import reasons, terminal_lines
from imocap_core.diagnostics.findings import Finding, Verdict
from imocap_core.library import running
from imocap_core.library.api_errors import FunctionDisplay
from imocap_core.library.running import LoggedDisplay, RunLog, expected_bytes, memory_notice
from imocap_core.library.terminal import Terminal
from imocap_core.pipeline.runner import Outcome
from imocap_core.version import __version__
from tests.pipeline.conftest import Toy


def record(toy: Toy) -> dict[str, Any]:
    return json.loads((toy.root / "artifacts" / "toy" / "run.json").read_text())


def test_a_run_is_recorded(toy: Toy) -> None:
    assert toy.imocap(["run", "toy"]) == 0
    first = record(toy)
    assert (first["status"], first["error"]) == ("done", None)
    assert first["versions"]["imocap"] == __version__
    assert [stage["how"] for stage in first["stages"]] == ["made"] * 3
    assert all(stage["peak_bytes"] > 2**20 for stage in first["stages"])
    assert first["params"]
    assert toy.imocap(["run", "toy"]) == 0
    second = record(toy)
    assert [stage["how"] for stage in second["stages"]] == ["cached"] * 3
    assert [s["digest"] for s in second["stages"]] == [s["digest"] for s in first["stages"]]


def test_a_failed_run_is_recorded(toy: Toy, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TOY_SCALE", "bad")
    assert toy.imocap(["run", "toy"]) == 1
    failed = record(toy)
    assert failed["status"] == "failed"
    assert failed["error"] == "scale: keypoints/v1: expected numbers, got [nonsense]"
    assert [stage["stage"] for stage in failed["stages"]] == ["gather"]


@pytest.mark.skipif(not process.CLEAR.exists(), reason="no /proc")
def test_peak_memory_is_that_since_the_restart() -> None:
    numbers = np.ones(2**25)
    before = process.peak_bytes()
    assert before > numbers.nbytes
    del numbers
    process.restart_peak()
    after = process.peak_bytes()
    assert after < before - 2**27


STORED = stored_as(Path("sync.mcap"), Content("Sync", b"{}", {}))


def shown(force_terminal: bool, verbose: bool = False) -> str:
    stream = io.StringIO()
    console = Console(file=stream, force_terminal=force_terminal, width=100, highlight=False)
    with Terminal(console, verbose=verbose) as display:
        display.started("sync", ["input: [gather] has changed"])
        display.progress(0.5, "comparing [v1]")
        display.finished(Outcome("sync", "made", STORED, 1.25, 300 * 2**20))
        display.finished(Outcome("smpl_ba", "cached", STORED, 0.0))
        display.made_demo("yoga", Path("actions/yoga"))
        display.waiting()
    return stream.getvalue()


@pytest.mark.parametrize("force_terminal", [False, True])
def test_lines_of_a_run(force_terminal: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")  # whatever the terminal that the tests run in can do
    monkeypatch.delenv("NO_COLOR", raising=False)
    text = shown(force_terminal, verbose=True)
    for part in ("because input: [gather] has changed", "made", "cached", "another run"):
        assert part in text
    assert ("\x1b[" in text) == force_terminal


def test_stages_share_a_line_where_no_bar_can_be() -> None:
    assert shown(False).splitlines()[:2] == ["sync 1 s", "Made actions/yoga"]


def test_verbose_lines_have_memory_and_digest() -> None:
    digest = STORED.digest[:12]
    lines = shown(False, verbose=True).splitlines()
    assert [lines[0], *lines[2:4]] == [
        "sync           because input: [gather] has changed",
        f"sync           made      1.2 s   300 MiB  {digest}",
        f"smpl_ba        cached    0.0 s {'':<9}  {digest}",
    ]


def test_verbose_lines_have_every_step() -> None:
    (step,) = [line for line in shown(False, verbose=True).splitlines() if "comparing" in line]
    assert step.split() == ["0.0", "s", "comparing", "[v1]"]
    assert "comparing" not in shown(False)


def test_many_reasons_are_counted() -> None:
    assert reasons(["a", "b"]) == "a; b"
    assert reasons(list("abcde")) == "a; b; c; and 2 more"


SUMMARY = ("Synchronised.", "Do not trust v1.", "Next: remove v1.")


def test_verbose_has_the_warnings_first() -> None:
    cut = Finding("detection", "v1", "a new shot begins with frame 9", "several shots")
    weak = Finding("joints", "v2", "least certain: left wrist", "wrist")
    remark = Finding("remark", "", "only two videos are left", "two videos")
    lines = terminal_lines(Verdict(SUMMARY, (cut, weak, remark)), verbose=True)
    assert tuple(lines[-3:]) == SUMMARY
    assert "* v1: a new shot begins with frame 9." in lines
    assert "* only two videos are left." in lines
    assert not any("wrist" in line for line in lines)  # the report has these


def test_the_terminal_has_the_three_sentences_however_much_there_is_to_know() -> None:
    feet = [Finding("feet", "v1", f"slide {k}", "slide", "", k, k) for k in range(12)]
    assert terminal_lines(Verdict(SUMMARY, tuple(feet))) == list(SUMMARY)


def test_remarks_take_one_line() -> None:
    assert shortened([]) == []
    assert shortened(["Wrote a."]) == ["Wrote a."]
    assert shortened(["x.", "y.", "Wrote a."]) == ["Wrote a (2 more remarks: --verbose)."]
    assert [counted(n, "video") for n in (0, 1, 2)] == ["0 videos", "1 video", "2 videos"]


def test_the_sentence_names_both_sizes_and_what_to_do() -> None:
    sentence = memory_notice([7200, 7000], 1_000_000_000)
    assert "2 videos, 14,200 frames, 7,200 in the longest" in sentence
    assert "1.00 GB are available: use fewer frames (`frames`" in sentence
    assert memory_notice([7200, 7000], 64_000_000_000) is None
    assert memory_notice([7200, 7000], None) is None
    assert memory_notice([], 1) is None


def test_memory_grows_with_the_longest_video_and_not_with_all_of_them_at_once() -> None:
    one, eight = expected_bytes([7200], 2), expected_bytes([7200] * 8, 2)
    assert eight - one < 7 * (one - expected_bytes([], 2)) / 2
    assert expected_bytes([1000] * 8, 2) < 1_800_000_000


def test_it_is_said_once_and_recorded(monkeypatch: pytest.MonkeyPatch) -> None:
    texts: list[str] = []
    shown = FunctionDisplay(lambda stage, share, text: texts.append(text))
    log = object.__new__(RunLog)  # its job is not asked for
    log.outcomes, log.notes = [], []
    monkeypatch.setattr(running, "frames_of", lambda keypoints: [7200, 7200])
    monkeypatch.setattr(running, "available_bytes", lambda: 10**9)
    display = LoggedDisplay(shown, log)
    display.started("initial_smpl", ["a"])  # the number of frames is not known yet
    outcome: Any = SimpleNamespace(stage="keypoints", stored=None)
    log.outcomes.append(outcome)
    for stage in ("camera_motion", "initial_smpl", "smpl_ba"):
        display.started(stage, ["b"])
    assert texts[:3] == ["because a", "because b", "because b"]
    assert "GB of memory are expected" in texts[3]
    assert texts[4:] == ["because b"]
    assert log.notes == [texts[3]]


Capture = pytest.CaptureFixture[str]


def with_cards(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: count > 0)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: count)


@pytest.mark.parametrize("command", [["run"], ["stage", "scale"], ["run-all"]])
def test_a_device_that_is_not_there_is_a_sentence_before_anything_runs(
    toy, monkeypatch, capsys, command
):
    with_cards(monkeypatch, 0)
    assert toy.imocap([*command, "toy", "--device", "cuda"]) == 2
    message = capsys.readouterr().err
    assert message.startswith("imocap: device cuda: PyTorch finds no CUDA device here")
    assert message.count("\n") == 1
    assert toy.imocap([*command, "toy", "--device", "gpu"]) == 2
    assert "expected cpu, cuda or cuda:1, got 'gpu'" in capsys.readouterr().err
    assert toy.ran() == []


def test_the_number_of_a_device_must_be_there(toy, monkeypatch, capsys):
    with_cards(monkeypatch, 2)
    assert toy.imocap(["run", "toy", "--device", "cuda:2"]) == 2
    assert "PyTorch finds CUDA devices cuda:0 to cuda:1 here" in capsys.readouterr().err


@pytest.mark.parametrize("command", [["run"], ["run-all", "--executor", "serial"]])
def test_results_are_not_made_again_for_another_device(toy, monkeypatch, command):
    with_cards(monkeypatch, 2)
    monkeypatch.setenv("IMOCAP_DEVICE", "cuda:1")
    assert toy.imocap([*command, "toy"]) == 0
    assert len(toy.ran()) == 3
    record = toy.root / "artifacts" / "toy" / "run.json"
    assert json.loads(record.read_text())["device"] == "cuda:1"
    assert toy.imocap([*command, "toy", "--device", "cpu"]) == 0
    assert toy.ran() == []
    assert json.loads(record.read_text())["device"] == "cpu"


def document(toy: Toy, capsys: Capture, *words: str, code: int = 0) -> Any:
    capsys.readouterr()
    assert toy.imocap([*words, "--json"]) == code
    return json.loads(capsys.readouterr().out)


def test_status(toy: Toy, capsys: Capture) -> None:
    rows = document(toy, capsys, "status", "toy")["stages"]
    assert rows[0] == {
        "stage": "gather", "state": "would run", "why": ["never run"], "digest": None,
    }  # fmt: skip
    toy.imocap(["run", "toy"])
    state = document(toy, capsys, "status", "toy")
    assert state["action"] == "toy"
    assert {row["stage"]: row["digest"] for row in state["stages"]} == toy.digests()
    assert {row["state"] for row in state["stages"]} == {"cached"}


def test_run(toy: Toy, capsys: Capture) -> None:
    first = document(toy, capsys, "run", "toy")
    assert [(row["stage"], row["how"]) for row in first["stages"]] == [
        ("gather", "made"), ("scale", "made"), ("evaluate", "made"),
    ]  # fmt: skip
    assert {row["stage"]: row["digest"] for row in first["stages"]} == toy.digests()
    again = document(toy, capsys, "run", "toy")
    assert {row["how"] for row in again["stages"]} == {"cached"}
    # a pipeline without these results says so
    assert [again[name] for name in ("trusted", "sync", "cameras", "verdict")] == [None] * 4


@pytest.mark.parametrize(
    ("words", "code", "fault"),
    [(["run", "toy"], 1, "expected numbers"), (["status", "nobody"], 2, "nobody")],
)
def test_what_fails_leaves_the_standard_output_empty(toy, capsys, monkeypatch, words, code, fault):
    monkeypatch.setenv("TOY_SCALE", "bad")
    assert toy.imocap([*words, "--json"]) == code
    shown = capsys.readouterr()
    assert shown.out == ""
    assert fault in shown.err


def test_explain(toy: Toy, capsys: Capture) -> None:
    before = document(toy, capsys, "explain", "toy", "scale")
    assert before["missing"] == ["gather"]
    assert "key" not in before
    toy.imocap(["run", "toy"])
    after = document(toy, capsys, "explain", "toy", "scale")
    assert (after["state"], after["why"], after["seed"]) == ("cached", [], 7)
    assert after["inputs"] == {"gather": toy.digests()["gather"]}
    assert after["params"]["sync"]["method"] == "softmap"


def test_doctor_reports_a_fault_in_its_exit_code_too(toy, capsys):
    good = document(toy, capsys, "doctor")
    assert good["ok"] is True
    assert all(check["works"] for check in good["checks"])
    (toy.root / "pipeline.yaml").write_text("seed: x\n")
    bad = document(toy, capsys, "doctor", code=1)
    assert bad["ok"] is False
    assert sum(not check["works"] for check in bad["checks"]) == 1


def test_values_become_json_s_types():
    @dataclass
    class Row:
        file: Path
        values: tuple[float, ...]

    row = Row(Path("a/b"), (1.5, float("nan"), np.float64(2.0), np.int64(3)))
    assert plain({"row": row}) == {"row": {"file": "a/b", "values": [1.5, None, 2.0, 3]}}

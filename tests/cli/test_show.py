"""What a run looks like: words in brackets survive, nothing moves where nothing can."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console

from imocap_core.artifacts.codec import Content
from imocap_core.artifacts.store import stored_as
from imocap_core.cli.run_commands import reasons
from imocap_core.library.terminal import Terminal
from imocap_core.pipeline.runner import Outcome

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

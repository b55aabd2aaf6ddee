"""Before stages that need more memory than there is, one sentence says so, once."""

from types import SimpleNamespace
from typing import Any

import pytest

from imocap_core.library import running
from imocap_core.library.api_errors import FunctionDisplay
from imocap_core.library.running import (
    LoggedDisplay,
    RunLog,
    available_bytes,
    expected_bytes,
    memory_notice,
)


def test_the_sentence_names_both_sizes_and_what_to_do() -> None:
    sentence = memory_notice([7200, 7000], 1_000_000_000)
    assert sentence is not None
    assert "2 videos, 14,200 frames, 7,200 in the longest" in sentence
    assert "1.00 GB are available: use fewer frames (`frames`" in sentence
    assert memory_notice([7200, 7000], 64_000_000_000) is None
    assert memory_notice([7200, 7000], None) is None
    assert memory_notice([], 1) is None


def test_memory_grows_with_the_longest_video_and_not_with_all_of_them_at_once() -> None:
    one, eight = expected_bytes([7200], 2), expected_bytes([7200] * 8, 2)
    assert eight - one < 7 * (one - expected_bytes([], 2)) / 2
    assert expected_bytes([1000] * 8, 2) < 1_800_000_000


def test_this_machine_has_memory() -> None:
    available = available_bytes()
    assert available is None or available > 2**28


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

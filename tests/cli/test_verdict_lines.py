"""The verdict on the terminal: warnings first, the three sentences last."""

from __future__ import annotations

from imocap_core.cli.run_commands import MAX_WARNINGS, terminal_lines
from imocap_core.verdict.findings import Finding, Verdict

SUMMARY = ("Synchronised.", "Do not trust v1.", "Next: remove v1.")


def test_the_last_lines_are_the_sentences() -> None:
    cut = Finding("detection", "v1", "a new shot begins with frame 9", "several shots")
    weak = Finding("joints", "v2", "least certain: left wrist", "wrist")
    remark = Finding("remark", "", "only two videos are left", "two videos")
    lines = terminal_lines(Verdict(SUMMARY, (cut, weak, remark)))
    assert tuple(lines[-3:]) == SUMMARY
    assert "* v1: a new shot begins with frame 9." in lines
    assert "* only two videos are left." in lines
    assert not any("wrist" in line for line in lines)  # the report has these


def test_many_warnings_are_cut_short() -> None:
    feet = [Finding("feet", "v1", f"slide {k}", "slide", "", k, k) for k in range(MAX_WARNINGS + 4)]
    lines = terminal_lines(Verdict(SUMMARY, tuple(feet)))
    assert sum(line.startswith("* v1") for line in lines) == MAX_WARNINGS
    assert "* 4 more in the report" in lines


def test_without_warnings_there_are_only_the_sentences() -> None:
    assert terminal_lines(Verdict(SUMMARY, ())) == ["", *SUMMARY]

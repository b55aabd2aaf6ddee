"""The verdict on the terminal: warnings first, the three sentences last."""

from __future__ import annotations

from imocap_core.cli.options import counted, shortened
from imocap_core.cli.run_commands import terminal_lines
from imocap_core.diagnostics.findings import Finding, Verdict

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

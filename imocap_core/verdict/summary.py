"""The three sentences of a verdict."""

from __future__ import annotations

from collections.abc import Sequence

from imocap_core.verdict.findings import Finding, listed

NAMED = 3  # faults that the second sentence names, and places of each


def summary_of(
    timing: str, findings: Sequence[Finding], least_certain: str, further: str
) -> tuple[str, ...]:
    """How well synchronised, what not to trust, what to do next.

    Args:
        timing: the first sentence.
        findings: the most serious first.
        least_certain, further: clauses on the least certain joint and on what to film; or empty.
    """
    serious = [finding for finding in findings if finding.serious]
    first = {"same take", "view"}  # kinds that the first sentence names
    rest = [finding for finding in serious if finding.kind not in first]
    second = distrust(rest) or _nothing_found(least_certain, len(rest) < len(serious))
    return tuple(s for s in (timing, second, next_step(serious, further)) if s)


def distrust(serious: Sequence[Finding]) -> str:
    """A sentence that names the parts not to be trusted, and why; empty when there are none."""
    if not serious:
        return ""
    parts = _parts(without_consequences(serious))
    more = len(parts) - NAMED
    named = parts[:NAMED] + ([f"{more} more part{'s' * (more > 1)}"] if more > 0 else [])
    return f"Do not trust {listed(named)}."


def without_consequences(findings: Sequence[Finding]) -> list[Finding]:
    """Those that do not mostly lie within an earlier, more serious one of the same video."""
    causes: list[Finding] = []
    for finding in findings:
        if not any(_within(finding, cause) for cause in causes):
            causes.append(finding)
    return causes


def _within(finding: Finding, cause: Finding) -> bool:
    """Whether half of the finding's frames lie within the cause's."""
    if finding.video != cause.video or finding.subject:
        return False
    if cause.first_frame is None or cause.last_frame is None:
        return True
    if finding.first_frame is None or finding.last_frame is None:
        return False
    common = min(finding.last_frame, cause.last_frame) - max(finding.first_frame, cause.first_frame)
    return 2 * (common + 1) >= finding.last_frame - finding.first_frame + 1


def next_step(serious: Sequence[Finding], further: str) -> str:
    """A sentence on what to do: the first remedy, else what to film."""
    remedy = next((f"{f.place}: {f.remedy}" for f in serious if f.remedy), "")
    if remedy and any(f.kind == "decision" for f in serious):
        further = ""  # first settle what was left out or mirrored
    steps = [step for step in (remedy, further) if step]
    return f"Next: {'; then '.join(steps)}." if steps else ""


def _nothing_found(least_certain: str, has_first: bool) -> str:
    end = f"; {least_certain}" if least_certain else ""
    none = (
        "No other fault was found"
        if has_first
        else "Nothing was found that speaks against the result"
    )
    return f"{none}{end}."


def _parts(findings: Sequence[Finding]) -> list[str]:
    """Places with what is wrong there; those with one fault together."""
    places: dict[str, list[str]] = {}
    for finding in findings:
        where = finding.subject or finding.place or "the result"
        places.setdefault(finding.brief, []).append(where)
    return [f"{_some(where)} ({brief})" for brief, where in places.items()]


def _some(places: Sequence[str]) -> str:
    more = len(places) - NAMED
    return listed([*places[:NAMED], *([f"{more} more"] if more > 0 else [])])

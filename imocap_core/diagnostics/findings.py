"""What a verdict is made of: findings about parts of videos, and at most three sentences."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

from pydantic import TypeAdapter, ValidationError

Kind = Literal[
    "decision",  # a video was left out or mirrored
    "same take",  # a recording that is there twice
    "up",  # which way gravity points
    "time",  # the correspondences
    "body",  # the recovered body
    "hidden",  # limbs that no video shows
    "feet",
    "detection",
    "camera",
    "view",  # depth that no video shows; the first sentence says it
    "repetition",  # a match that may be a whole repetition off; the first sentence says it
    "joints",  # ill-determined ones
    "remark",  # worth knowing, no reason for distrust
]
SERIOUS: frozenset[Kind] = frozenset(
    {"decision", "same take", "up", "time", "body", "hidden", "feet", "detection", "camera", "view"}
)
WHOLE: frozenset[Kind] = frozenset({"decision", "same take", "up", "time", "body"})
DOUBTFUL_S = 0.1  # of disagreement between the videos' times
SENTENCES = 3
Level = Literal["good", "check", "doubt"]


@dataclass(frozen=True)
class Finding:
    """Something to know about a video, or about a span of it.

    Attributes:
        video: its id; empty for what concerns all videos.
        text: a clause without the video's name and without a full stop.
        brief: the same in a few words, for the summary.
        remedy: what to do about it; a clause, or empty.
        first_frame, last_frame: source frames, both within; None for the whole video.
        subject: what is not to be trusted, where that is no video, as in "the left hand".
    """

    kind: Kind
    video: str
    text: str
    brief: str
    remedy: str = ""
    first_frame: int | None = None
    last_frame: int | None = None
    subject: str = ""

    @property
    def serious(self) -> bool:
        """Whether it is a reason not to trust the result there."""
        return self.kind in SERIOUS

    @property
    def place(self) -> str:
        """The video, and its frames where only some are meant."""
        if self.first_frame is None:
            return self.video
        return f"{self.video} {frames_text(self.first_frame, self.last_frame)}"

    @property
    def sentence(self) -> str:
        """The finding and its remedy."""
        where = f"{self.place}: " if self.video else ""
        return where + "; ".join(part for part in (self.text, self.remedy) if part) + "."


@dataclass(frozen=True)
class Verdict:
    """What a person must know about a result, without truth.

    Attributes:
        summary: at most three sentences: how well synchronised; what not to trust; what to do.
        findings: the reasons, the most serious first.
        disagreement_s: how far the videos' times disagree among three or more; None where nothing
            checks them.
        checked: whether anything checks the times: a third video, or a shared event.
    """

    summary: tuple[str, ...]
    findings: tuple[Finding, ...]
    disagreement_s: float | None = None
    checked: bool = True

    def __post_init__(self) -> None:
        assert len(self.summary) <= SENTENCES

    @property
    def trusted(self) -> bool:
        """Whether nothing was found that speaks against the result."""
        return not any(finding.serious for finding in self.findings)

    @property
    def level(self) -> Level:
        """Doubt: times or whole videos are wrong; check: parts may be, or nothing checks it."""
        whole = any(f.kind in WHOLE and f.first_frame is None for f in self.findings)
        if whole or (self.disagreement_s or 0) > DOUBTFUL_S:
            return "doubt"
        unsure = any(f.serious or f.kind == "repetition" for f in self.findings)
        return "check" if unsure or not self.checked else "good"

    def __str__(self) -> str:
        return "\n".join(self.summary)


def frames_text(first: int, last: int | None) -> str:
    """'frame 4' or 'frames 4-9'."""
    return f"frame {first}" if last in (None, first) else f"frames {first}-{last}"


def listed(words: Sequence[str], last: str = "and") -> str:
    """'a', 'a and b', 'a, b and c'; ``last``: before the last one."""
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} {last} {words[-1]}"


FILE = "verdict.json"


def verdict_document(verdict: Verdict) -> dict[str, Any]:
    """Plain data: the fields, and of each finding its sentence and whether it is serious."""
    document = asdict(verdict)
    for fields, finding in zip(document["findings"], verdict.findings, strict=True):
        fields |= {"sentence": finding.sentence, "serious": finding.serious}
    return document | {"trusted": verdict.trusted, "level": verdict.level}


def verdict_text(verdict: Verdict) -> str:
    """The document as JSON text."""
    return json.dumps(verdict_document(verdict), indent=1, ensure_ascii=False) + "\n"


def read_verdict(text: str) -> Verdict:
    """The verdict of a JSON text. ValueError when it is none."""
    try:
        verdict = TypeAdapter(Verdict).validate_json(text, strict=True)
    except ValidationError:
        raise ValueError("expected a verdict") from None
    texts = [*verdict.summary]
    for one in verdict.findings:
        texts += [one.video, one.text, one.brief, one.remedy, one.subject]
    if not all(text.isprintable() for text in texts):  # others control a terminal
        raise ValueError("expected sentences, got control characters")
    return verdict

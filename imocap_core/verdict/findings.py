"""What a verdict is made of: findings about parts of videos, and at most three sentences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

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
    "joints",  # ill-determined ones
    "remark",  # worth knowing, no reason for distrust
]
SERIOUS: frozenset[Kind] = frozenset(
    {"decision", "same take", "up", "time", "body", "hidden", "feet", "detection", "camera", "view"}
)
SENTENCES = 3


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
    """

    summary: tuple[str, ...]
    findings: tuple[Finding, ...]
    disagreement_s: float | None = None

    def __post_init__(self) -> None:
        assert len(self.summary) <= SENTENCES

    @property
    def trusted(self) -> bool:
        """Whether nothing was found that speaks against the result."""
        return not any(finding.serious for finding in self.findings)

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

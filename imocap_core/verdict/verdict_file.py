"""A verdict as JSON, for programs and for runs in which everything is cached."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any, get_args

from imocap_core.verdict.findings import SENTENCES, Finding, Kind, Verdict

FILE = "verdict.json"
DERIVED = ("sentence", "serious")  # of a finding's fields in the file


def verdict_document(verdict: Verdict) -> dict[str, Any]:
    """Plain data: the fields, and of each finding its sentence and whether it is serious."""
    document = asdict(verdict)
    for fields, finding in zip(document["findings"], verdict.findings, strict=True):
        fields |= {"sentence": finding.sentence, "serious": finding.serious}
    return document | {"trusted": verdict.trusted}


def verdict_text(verdict: Verdict) -> str:
    """The document as JSON text."""
    return json.dumps(verdict_document(verdict), indent=1, ensure_ascii=False) + "\n"


def read_verdict(text: str) -> Verdict:
    """The verdict of a JSON text. ValueError when it is none."""
    try:
        document = json.loads(text)
        findings = tuple(_finding(fields) for fields in document["findings"])
        summary, disagreement_s = document["summary"], document["disagreement_s"]
    except (LookupError, TypeError, AttributeError, RecursionError):
        raise ValueError("expected a verdict") from None
    sentences = isinstance(summary, list) and len(summary) <= SENTENCES and _are_plain(summary)
    if not (sentences and isinstance(disagreement_s, int | float | None)):
        raise ValueError("expected sentences, and how far the videos' times disagree")
    return Verdict(tuple(summary), findings, disagreement_s)


def _finding(fields: dict[str, Any]) -> Finding:
    finding = Finding(**{name: x for name, x in fields.items() if name not in DERIVED})
    texts = (finding.video, finding.text, finding.brief, finding.remedy, finding.subject)
    frames = (finding.first_frame, finding.last_frame)
    numbered = all(isinstance(frame, int | None) for frame in frames)
    if finding.kind not in get_args(Kind) or not (numbered and _are_plain(texts)):
        raise ValueError("expected a finding: a kind, sentences, frames")
    return finding


def _are_plain(texts: Iterable[object]) -> bool:
    """Whether all are texts without characters that control a terminal."""
    return all(isinstance(text, str) and text.isprintable() for text in texts)

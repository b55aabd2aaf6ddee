"""A verdict as JSON, for programs and for runs in which everything is cached."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

from imocap_core.verdict.findings import Finding, Verdict

FILE = "verdict.json"


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
    """The verdict of a JSON text. ValueError or KeyError when it is none."""
    document = json.loads(text)
    findings = []
    for fields in document["findings"]:
        derived = ("sentence", "serious")
        findings.append(Finding(**{k: x for k, x in fields.items() if k not in derived}))
    return Verdict(tuple(document["summary"]), tuple(findings), document["disagreement_s"])

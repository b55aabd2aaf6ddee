"""Parameters of the evaluation and its report."""

from __future__ import annotations

from dataclasses import dataclass

from imocap_core.params.bounds import param


@dataclass(frozen=True, kw_only=True)
class EvaluateParams:
    """Metrics, tables and figures (report.md)."""

    figures: bool = param(True, "Draw the report's figures. Without them it is written faster.")

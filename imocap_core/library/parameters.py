"""The parameters of a working folder: value, default, unit, bounds, meaning."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from imocap_core.library.door import plain_errors
from imocap_core.params.table import parameter_table
from imocap_core.workspace import Workspace


@dataclass(frozen=True)
class ParameterValue:
    """One parameter; value: that of pipeline.yaml; bounds: in words; doc: its meaning."""

    group: str
    name: str
    value: Any
    default: Any
    unit: str
    bounds: str
    doc: str


@plain_errors
def parameters(group: str | None = None, *, root: str | Path = ".") -> list[ParameterValue]:
    """All parameters, or those of one group; WrongUse for an unknown group."""
    in_force = Workspace(Path(root)).pipeline().params
    return [
        ParameterValue(row.group, row.name, row.value, default.value, row.unit, row.bounds, row.doc)
        for row, default in zip(
            parameter_table(group, in_force), parameter_table(group), strict=True
        )
    ]

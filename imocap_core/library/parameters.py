"""The parameters of a working folder: value, default, unit, bounds, meaning."""

from __future__ import annotations

from pathlib import Path

from imocap_core.library.door import plain_errors
from imocap_core.params.table import Parameter, parameter_table
from imocap_core.workspace import Workspace


@plain_errors
def parameters(group: str | None = None, *, root: str | Path = ".") -> list[Parameter]:
    """All parameters, or those of one group, with pipeline.yaml's values; WrongUse for an unknown
    group."""
    return parameter_table(group, Workspace(Path(root)).pipeline().params)

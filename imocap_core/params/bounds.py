"""Types with bounds, and the one way to declare a parameter.

Only the standard library and `annotated_types`: the core takes groups of parameters and must not
need pydantic for that. What reads values from files validates these annotations
(`imocap_core.pipeline.graph`).
"""

from __future__ import annotations

from dataclasses import field
from typing import Annotated, Any

from annotated_types import Ge, Gt, Interval

Count = Annotated[int, Ge(1)]
WholeNumber = Annotated[int, Ge(0)]
NonNegative = Annotated[float, Ge(0)]
Positive = Annotated[float, Gt(0)]
Share = Annotated[float, Interval(ge=0, le=1)]


def param(default: Any, doc: str, *, unit: str = "") -> Any:
    """A parameter as a dataclass field: its default, its unit, and what it does.

    doc: Markdown for users; unit: as shown in tables, also the end of the parameter's name.
    """
    metadata = {"doc": doc, "unit": unit}
    if isinstance(default, dict):
        return field(default_factory=lambda: dict(default), metadata=metadata)
    return field(default=default, metadata=metadata)

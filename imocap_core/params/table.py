"""All parameters as rows: for `imocap params`, docs/parameters.md, and scripts."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from dataclasses import dataclass, fields
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from annotated_types import Gt, Interval

from imocap_core.params import Params

NAMES = {float: "number", int: "whole number", str: "text", bool: "true or false"}


@dataclass(frozen=True)
class Parameter:
    """One parameter. value: that in force, or the default; bounds: in words; doc: its meaning."""

    group: str
    name: str
    value: Any
    default: Any
    unit: str
    bounds: str
    doc: str


def parameter_table(group: str | None = None, params: Params | None = None) -> list[Parameter]:
    """The parameters of one group, or of all, in order.

    params: whose values are shown, the defaults when None. ValueError for an unknown group; the
    message lists all.
    """
    groups = [f.name for f in fields(Params)]
    if group is not None and group not in groups:
        raise ValueError(f"no group of parameters {group!r} (the groups are: {', '.join(groups)})")
    values = params or Params()
    wanted = groups if group is None else [group]
    return [row for name in wanted for row in _rows(name, values)]


def group_doc(group: str) -> str:
    """What a group is about, as Markdown."""
    return inspect.cleandoc(type(getattr(Params(), group)).__doc__ or "")


def _rows(group: str, params: Params) -> Iterator[Parameter]:
    values, defaults = getattr(params, group), getattr(Params(), group)
    hints = get_type_hints(type(values), include_extras=True)
    for f in fields(values):
        yield Parameter(
            group=group,
            name=f.name,
            value=getattr(values, f.name),
            default=getattr(defaults, f.name),
            unit=f.metadata["unit"],
            bounds=_bounds(hints[f.name]),
            doc=f.metadata["doc"],
        )


def _bounds(hint: Any) -> str:
    """A type with its bounds in words: "number > 0", "als, svt or none"."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return f"{_bounds(inner[0])} {_limits(inner[1:])}"
    if origin is Literal:
        return f"{', '.join(inner[:-1])} or {inner[-1]}"
    if origin is dict:
        return f"name: {_bounds(inner[1])}"
    if origin is UnionType:
        return " or ".join("null" if part is NoneType else _bounds(part) for part in inner)
    return NAMES[hint]


def _limits(marks: tuple[Any, ...]) -> str:
    """Bounds in words: "> 0", "≥ 1", "from 0 to 1"."""
    (mark,) = marks
    if isinstance(mark, Interval):
        return f"from {mark.ge} to {mark.le}"
    return f"> {mark.gt}" if isinstance(mark, Gt) else f"≥ {mark.ge}"

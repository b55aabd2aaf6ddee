"""One-off parameters of a call, as the command line's `--set` takes them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from imocap_core.errors import WrongUse

Params = Mapping[str, Any] | Sequence[str] | None
"""One-off parameters: {"sync": {"max_rate": 8}}, {"sync.max_rate": 8} or ["sync.max_rate=8"]."""


def one_off(params: Params) -> list[str]:
    """Parameters as the command line's `--set` takes them: group.name=value."""
    if params is None:
        return []
    if not isinstance(params, Mapping):
        return list(params)
    texts = []
    for key, value in params.items():
        nested = value.items() if isinstance(value, Mapping) and "." not in key else None
        pairs = [(key, value)] if nested is None else [(f"{key}.{n}", v) for n, v in nested]
        texts += [f"{path}={_yaml(path, content)}" for path, content in pairs]
    return texts


def _yaml(path: str, value: Any) -> str:
    try:
        return json.dumps(value)
    except TypeError:
        raise WrongUse(
            f"params: {path}: expected numbers, words, lists or mappings, "
            f"got {type(value).__name__}"
        ) from None

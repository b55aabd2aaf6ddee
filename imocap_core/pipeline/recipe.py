"""A recipe: everything that determines a result, and the key that it is stored under."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

FORMAT = 1  # raise when the way artifacts are made or stored changes what they mean


@dataclass(frozen=True)
class Recipe:
    """Everything that determines a result; every leaf is a value or a digest."""

    code: Mapping[str, str]  # module -> digest
    params: Mapping[str, Mapping[str, Any]]
    seed: int
    inputs: Mapping[str, str]  # stage -> content digest
    reads: Mapping[str, str]  # "videos v1" -> content digest
    format: int = FORMAT

    @property
    def key(self) -> str:
        """The stage key."""
        return hashlib.sha256(canonical(asdict(self)).encode()).hexdigest()

    def provenance(self) -> dict[str, str]:
        """The recipe as text, to be stored with a result."""
        return {name: canonical(value) for name, value in asdict(self).items()}


def canonical(value: Any) -> str:
    """Equal values as equal text (JSON)."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"))

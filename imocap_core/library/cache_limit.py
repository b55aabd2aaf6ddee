"""The limit of a working folder's cache: beyond it, the least recently used results go.

IMOCAP_CACHE_LIMIT sets it, as in 50GB; 0 turns it off.
"""

from __future__ import annotations

import os
from pathlib import Path

from imocap_core.artifacts.cache import cached_results
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.library.cleaning import bytes_of, clean
from imocap_core.workspace import Workspace

VARIABLE = "IMOCAP_CACHE_LIMIT"
DEFAULT = "20GB"


def cache_limit_bytes() -> int | None:
    """The limit in force; None where there is none. WrongUse when it is no size."""
    text = os.environ.get(VARIABLE) or DEFAULT
    try:
        return bytes_of(text) or None
    except WrongUse as error:
        raise WrongUse(f"{VARIABLE}: {error}") from None


def keep_cache_within_limit(root: Path) -> list[str]:
    """Remove old results of a cache that is too large, as `imocap clean` does; a sentence if any
    were removed. Nothing happens while another run is in progress."""
    limit = cache_limit_bytes()
    if limit is None:  # and nothing is looked at: a cache of 10,000 actions takes seconds
        return []
    results = cached_results(Workspace(root).store.folder)
    if sum(result.size_bytes for result in results) <= limit:
        return []
    try:
        cleaning = clean(max_bytes=limit, root=root)
    except WorkFailed:
        return []
    if not cleaning.removed:
        return []
    size = f"{cleaning.removed_bytes / 1e9:.1f} GB"
    return [f"The cache was over {limit / 1e9:g} GB ({VARIABLE}): {size} of old results removed."]

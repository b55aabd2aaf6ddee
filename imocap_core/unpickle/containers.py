"""Containers of pickles within limits: keys that are cheap to compare, and shared parts counted.

A hundred bytes of a pickle can describe a tree of billions of parts, each of which is in memory
once; comparing keys of that kind, or making arrays of such lists, would never end.
"""

from __future__ import annotations

import pickle
from collections import defaultdict
from collections.abc import Callable, Iterable
from typing import Any

from imocap_core.limits import MAX_ELEMENTS
from imocap_core.unpickle.records import ArrayRecord, JoblibRecord

PLAIN = (str, bytes, int, float, complex, bool, type(None))


def check_keys(keys: Iterable[Any]) -> None:
    """UnpicklingError unless these are plain values, or tuples of them."""
    for key in keys:
        parts = key if isinstance(key, tuple) else (key,)
        if not all(isinstance(part, PLAIN) for part in parts):
            raise pickle.UnpicklingError("it contains keys that are no words or numbers")


def check_size(value: Any) -> None:
    """UnpicklingError when nested lists, tuples and dictionaries have too many parts, those that
    are in several places counted in each."""
    _size(value, {}, set())


def _size(value: Any, sizes: dict[int, int], above: set[int]) -> int:
    if not isinstance(value, (list, tuple, dict, ArrayRecord, JoblibRecord)):
        return 1
    if id(value) in above:
        raise pickle.UnpicklingError("it contains itself")
    if id(value) not in sizes:
        above.add(id(value))
        sizes[id(value)] = 1 + sum(_size(part, sizes, above) for part in _parts(value))
        above.remove(id(value))
        if sizes[id(value)] > MAX_ELEMENTS:
            raise pickle.UnpicklingError("it contains more parts than can be read")
    return sizes[id(value)]


def _parts(value: Any) -> Iterable[Any]:
    if isinstance(value, ArrayRecord):
        return value.state
    if isinstance(value, JoblibRecord):
        return (value.content,)
    return value.values() if isinstance(value, dict) else value


def _dict(*content: Any) -> dict[Any, Any]:
    pairs = [list(pair) for pair in content[0]] if content else []
    check_keys(pair[0] for pair in pairs)
    return dict(pairs)


def _set(content: Any = ()) -> set[Any]:
    check_keys(content)
    return set(content)


def _bytearray(*content: Any) -> bytes:
    """As protocols below 5 write it: of words; a size alone would make room for that many."""
    if content and not isinstance(content[0], (bytes, str)):
        raise pickle.UnpicklingError("it would make a bytearray of a number")
    first = content[0] if content else b""
    return first.encode("latin1") if isinstance(first, str) else first


def defaultdict_of(*arguments: Any) -> defaultdict[Any, Any]:
    """Without what it would make for a missing key."""
    return defaultdict(None)


CONTAINERS: dict[str, Callable[..., Any]] = {"dict": _dict, "set": _set, "bytearray": _bytearray}

"""Damage to a file's content: bytes changed at random, and values of JSON and YAML exchanged."""

import copy
import json
import random
from typing import Any

ODD: list[Any] = [
    *(None, True, "", "text", "9" * 5000, "../../x", [], {}, [[]], [None], {"x": {}}),
    *(0, -1, 1.5, 10**9, 10**400, -(10**30), 1e308, -0.0, float("nan"), float("inf")),
]
TOKENS = [b"\0", b"\xff" * 8, b"[" * 200, b"{" * 50, b'"', b"-", b"9" * 400, b"e999", b"&a [*a]"]


def damaged(content: bytes, name: str, rng: random.Random) -> bytes:
    """One damaged version of a file's content; name: the file's, for its kind."""
    if name.endswith(".json") and rng.random() < 0.7:
        return json.dumps(_odd_value(json.loads(content), rng)).encode()
    if name.endswith(".yaml") and rng.random() < 0.7:
        import yaml

        return yaml.safe_dump(_odd_value(yaml.safe_load(content), rng)).encode()
    for _ in range(rng.choice([1, 1, 2, 8])):
        content = _odd_bytes(content, rng)
    return content


def _odd_value(tree: Any, rng: random.Random) -> Any:
    """A tree in which some value is another, is missing, or is there twice."""
    tree = copy.deepcopy(tree)
    spots = list(_spots(tree))
    if not spots:
        return rng.choice(ODD)
    for _ in range(rng.choice([1, 1, 3])):
        holder, key = rng.choice(spots)
        how = rng.random()
        if isinstance(holder, dict) and how < 0.15:
            holder.pop(key, None)
        elif isinstance(holder, dict) and how < 0.25 and key in holder:
            holder[rng.choice(["", "unknown", "9" * 30])] = holder.pop(key)
        elif isinstance(holder, list) and how < 0.25 and key < len(holder):
            holder.insert(key, copy.deepcopy(holder[key]))
        elif isinstance(holder, dict) or key < len(holder):
            holder[key] = copy.deepcopy(rng.choice(ODD))
    return tree


def _spots(tree: Any) -> list[tuple[Any, Any]]:
    if not isinstance(tree, (dict, list)):
        return []
    spots: list[tuple[Any, Any]] = []
    for key, value in tree.items() if isinstance(tree, dict) else enumerate(tree):
        spots += [(tree, key), *_spots(value)]
    return spots


def _odd_bytes(content: bytes, rng: random.Random) -> bytes:
    place = rng.randrange(len(content) + 1)
    length = rng.choice([1, 2, 4, 8, 64])
    how = rng.randrange(6)
    if how == 0:
        return content[:place]
    if how == 1:
        return content[:place] + content[place + length :]
    if how == 2:
        return content[:place] + rng.randbytes(length) + content[place + length :]
    if how == 3:
        return content[:place] + rng.choice(TOKENS) + content[place:]
    if how == 4:
        return content[:place] + content[place : place + length] * 3 + content[place + length :]
    flipped = bytearray(content)
    if place < len(flipped):
        flipped[place] ^= 1 << rng.randrange(8)
    return bytes(flipped)

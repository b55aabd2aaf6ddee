"""YAML files of people: plain values, read within limits.

Aliases are followed, but what they stand for is counted each time: a few lines can describe a tree
of billions of values, which no later step could walk.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from imocap_core.errors import WorkFailed
from imocap_core.limits import MAX_YAML_BYTES, MAX_YAML_NODES, must_be_small_enough

if TYPE_CHECKING:
    from yaml.nodes import Node


def load_yaml(file: Path) -> Any:
    """The content of a YAML file; WorkFailed with the line when it is not YAML, or is too large."""
    import yaml

    try:
        if file.exists() and not file.is_file():
            raise WorkFailed(f"{file}: expected a file, got something else")
        must_be_small_enough(file, MAX_YAML_BYTES)
        return load_yaml_text(file.read_text(encoding="utf-8"))
    except (yaml.YAMLError, RecursionError) as error:
        raise WorkFailed(f"{file} is not YAML: {' '.join(str(error).split())[:300]}") from None
    except UnicodeDecodeError as error:
        raise WorkFailed(f"cannot read {file}: {error}") from None
    except ValueError as error:  # a number or a date that cannot be
        reason = str(error)
        raise WorkFailed(reason if str(file) in reason else f"{file}: {reason}") from None
    except OSError as error:
        raise WorkFailed(f"cannot read {file}: {error.strerror}") from None


def load_yaml_text(text: str) -> Any:
    """Plain values. YAMLError, ValueError or RecursionError for a text that is refused."""
    import yaml

    loader = yaml.SafeLoader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        _size(node, {}, frozenset())
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _size(node: Node, sizes: dict[int, int], above: frozenset[int]) -> int:
    """Values in the tree of a node, those of an alias counted each time; ValueError when there are
    too many, or it contains itself."""
    if id(node) in above:
        raise ValueError(f"line {node.start_mark.line + 1}: an alias contains itself")
    if id(node) not in sizes:
        inside = above | {id(node)}
        sizes[id(node)] = 1 + sum(_size(part, sizes, inside) for part in _parts(node))
        if sizes[id(node)] > MAX_YAML_NODES:
            raise ValueError(
                f"line {node.start_mark.line + 1}: expected at most {MAX_YAML_NODES:,} values, "
                f"its aliases stand for more"
            )
    return sizes[id(node)]


def _parts(node: Node) -> list[Node]:
    """The items of a sequence, the keys and values of a mapping."""
    if not isinstance(node.value, list):
        return []
    return [p for item in node.value for p in (item if isinstance(item, tuple) else (item,))]

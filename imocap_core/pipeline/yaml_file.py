"""YAML files of people: read within limits, edited so that the rest stays as it is.

Aliases are followed, but what they stand for is counted each time: a few lines can describe a tree
of billions of values, which no later step could walk.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from difflib import SequenceMatcher
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.util import load_yaml_guess_indent

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
        where = " ".join(str(error).replace('in "<unicode string>", ', "at ").split())[:300]
        raise WorkFailed(f"{file} is not YAML: {where.removesuffix(': ^')}") from None
    except UnicodeDecodeError as error:
        raise WorkFailed(f"cannot read {file}: {error}; save it as UTF-8") from None
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
        parts = node.value if isinstance(node.value, list) else []
        flat = [p for part in parts for p in (part if isinstance(part, tuple) else (part,))]
        sizes[id(node)] = 1 + sum(_size(part, sizes, inside) for part in flat)
        if sizes[id(node)] > MAX_YAML_NODES:
            raise ValueError(
                f"line {node.start_mark.line + 1}: expected at most {MAX_YAML_NODES:,} values, "
                f"its aliases stand for more"
            )
    return sizes[id(node)]


Change = Callable[[Any], None]
WHOLE_LINES = 2**20  # characters of a line before it would be broken


def edited_text(text: str, change: Change) -> str:
    """The text after a change of its content.

    `change` alters plain values in place. Reading the result gives what the change makes of the
    content; WorkFailed where that cannot be written, as with aliases. ValueError, RecursionError or
    yaml.YAMLError when `text` is no YAML; errors of `change` pass.
    """
    content = deepcopy(load_yaml_text(text))
    change(content)
    lines_end = "\r\n" if "\r\n" in text else "\n"
    plain = text.replace("\r\n", "\n")
    try:
        yaml, document = _round_trip(plain)
        before = _dump(yaml, document)
        change(document)
        after = _dump(yaml, document)
    except YAMLError as error:
        raise WorkFailed(_refusal(str(error))) from None
    for candidate in (_merged(plain, before, after), after):
        if candidate is not None and load_yaml_text(candidate) == content:
            return candidate.replace("\n", lines_end)
    raise WorkFailed(_refusal("an alias or an unusual form of YAML is in the way"))


def _refusal(reason: str) -> str:
    return f"action.yaml cannot be changed from here ({' '.join(reason.split())[:200]}); edit it"


def _round_trip(text: str) -> tuple[YAML, Any]:
    """A reader and writer with the indents of a text, and its document."""
    yaml = YAML()
    yaml.preserve_quotes = True
    yaml.width = WHOLE_LINES
    _, sequence, offset = load_yaml_guess_indent(text)
    if sequence is not None:
        yaml.indent(mapping=2, sequence=max(sequence, (offset or 0) + 2), offset=offset or 0)
    yaml.representer.add_representer(
        type(None), lambda r, _: r.represent_scalar("tag:yaml.org,2002:null", "null")
    )
    return yaml, yaml.load(text)


def _dump(yaml: YAML, document: Any) -> str:
    stream = StringIO()
    yaml.dump(document, stream)
    return stream.getvalue()


def _merged(original: str, before: str, after: str) -> str | None:
    """The original with the lines that differ between two dumps of it, before and after a change.

    None where the dump has other lines than the original. A comment belongs to what follows it: new
    lines come above the comments before their place, removed ones leave those behind them, and the
    comments on an item of a list go with it.
    """
    lines, a, b = (text.splitlines(keepends=True) for text in (original, before, after))
    if lines and not lines[-1].endswith("\n"):
        lines[-1] += "\n"
    if len(lines) != len(a):
        return None
    merged: list[str] = []
    for tag, i, j, k, m in SequenceMatcher(None, a, b, autojunk=False).get_opcodes():
        if tag == "equal":
            merged += lines[i:j]
        elif tag == "insert":
            place = len(merged) - _trailing_comments(merged)
            merged[place:place] = b[k:m]
        else:
            removed = lines[i:j]
            if tag == "delete" and removed[0].lstrip().startswith("- "):
                del merged[len(merged) - _comments_above(merged, removed[0]) :]
            behind = 0 if _trailing_comments(b[k:m]) else _trailing_comments(removed)
            merged += b[k:m] + removed[len(removed) - behind :]
    return "".join(merged)


def _trailing_comments(lines: Sequence[str]) -> int:
    """Number of lines at the end that are comments or blank."""
    count = 0
    for line in reversed(lines):
        if line.strip() and not line.lstrip().startswith("#"):
            break
        count += 1
    return count


def _comments_above(lines: Sequence[str], item: str) -> int:
    """Number of comments at the end that are directly above an item and as far to the right."""
    indent = item[: len(item) - len(item.lstrip())]
    count = 0
    while count < len(lines) and lines[-1 - count].startswith(f"{indent}#"):
        count += 1
    return count

"""One Python file as what counts of it: its code, its imports, what it re-exports."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import TypedDict

WITH_DOCSTRING = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


class ParsedSource(TypedDict):
    """A file's syntax tree in short, as JSON can hold it.

    digest: of the tree without docstrings. imports: [module, None] of `import module`, [module,
    name] of `from module import name`, wherever they stand in the file. exports: of an __init__
    that only re-exports, name -> [module, name there]; else None.
    """

    digest: str
    imports: list[tuple[str, str | None]]
    exports: dict[str, tuple[str, str]] | None


def parse_source(file: Path, module: str, packages: Sequence[str]) -> ParsedSource:
    """Parse a file; of its imports those of `packages` are kept. SyntaxError, OSError.

    module: its dotted name, to which relative imports are relative.
    """
    tree = ast.parse(file.read_bytes(), filename=str(file))
    is_package = file.name == "__init__.py"
    code, imported = _written(tree)
    imports: list[tuple[str, str | None]] = []
    for node in imported:
        if isinstance(node, ast.Import):
            imports += [(alias.name, None) for alias in node.names]
        else:
            base = _absolute(node, module, is_package)
            imports += [(base, alias.name) for alias in node.names]
    return {
        "digest": hashlib.sha256(code.encode()).hexdigest(),
        "imports": [one for one in imports if one[0].split(".")[0] in packages],
        "exports": _exports(tree, module) if is_package else None,
    }


def _written(tree: ast.Module) -> tuple[str, list[ast.Import | ast.ImportFrom]]:
    """The tree without docstrings and line numbers, as text, and its imports.

    One walk: `ast.walk` and `ast.dump` take twice the time, for which a first run would wait.
    """
    out: list[str] = []
    imports: list[ast.Import | ast.ImportFrom] = []

    def write(value: object) -> None:
        if isinstance(value, ast.AST):
            kind = type(value)
            if kind is ast.Import or kind is ast.ImportFrom:
                imports.append(value)  # type: ignore[arg-type]  # of these kinds
            elif kind in WITH_DOCSTRING:
                value.body = _without_docstring(value.body)  # type: ignore[attr-defined]
            out.append(kind.__name__)
            for name in kind._fields:
                if name != "ctx":  # whether it is read or set: its place in the tree says that
                    out.append("(")
                    write(getattr(value, name))
            out.append(")")
        elif isinstance(value, list):
            out.append("[")
            for one in value:
                write(one)
            out.append("]")
        else:
            out.append(repr(value))

    write(tree)
    return "\0".join(out), imports


def _exports(tree: ast.Module, module: str) -> dict[str, tuple[str, str]] | None:
    names: dict[str, tuple[str, str]] = {}
    for node in tree.body:
        if isinstance(node, ast.ImportFrom):
            base = _absolute(node, module, is_package=True)
            names.update({a.asname or a.name: (base, a.name) for a in node.names})
        elif not _is_all(node):
            return None
    return names


def _absolute(node: ast.ImportFrom, module: str, is_package: bool) -> str:
    """The module that `from ... import` names, relative dots resolved."""
    if node.level == 0:
        return node.module or ""
    parts = module.split(".")
    package = parts if is_package else parts[:-1]
    package = package[: len(package) - node.level + 1]
    return ".".join([*package, *([node.module] if node.module else [])])


def _is_all(node: ast.stmt) -> bool:
    return isinstance(node, ast.Assign) and [
        t.id for t in node.targets if isinstance(t, ast.Name)
    ] == ["__all__"]


def _without_docstring(body: list[ast.stmt]) -> list[ast.stmt]:
    first = body[0] if body else None
    if (
        isinstance(first, ast.Expr)
        and isinstance(first.value, ast.Constant)
        and isinstance(first.value.value, str)
    ):
        return body[1:]
    return body

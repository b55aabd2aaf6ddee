"""The code a stage's result depends on, found without importing anything.

From the stage's script, imports are followed through this project. A file counts by its syntax
tree without docstrings, so comments, layout and documentation don't make results stale; data files
of a package (the body model) count by their bytes. A room whose __init__ only re-exports is looked
through: importing one name of it is depending on the file that defines that name, not on all of it.

The rooms in CARRIERS are left out: they carry values and compute none.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[2]
PACKAGES = ("imocap_core", "stages", "benchmarks")
CARRIERS = (
    "imocap_core.cli",
    "imocap_core.errors",
    "imocap_core.params",
    "imocap_core.pipeline",
    "imocap_core.workspace",
)


@dataclass(frozen=True)
class Source:
    """One Python file of the project (or a script outside it, with an empty module name)."""

    module: str
    file: Path

    @cached_property
    def tree(self) -> ast.Module:
        """Its syntax tree, without docstrings."""
        tree = ast.parse(self.file.read_bytes(), filename=str(self.file))
        for node in ast.walk(tree):
            if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
                node.body = _without_docstring(node.body)
        return tree

    @property
    def is_package(self) -> bool:
        """Whether this is the __init__ of a package."""
        return self.file.name == "__init__.py"

    @cached_property
    def digest(self) -> str:
        """Digest of its syntax tree, and of the data files when it is a package."""
        sha = hashlib.sha256(ast.dump(self.tree).encode())
        if self.is_package and self.module:
            for file in _data_files(self.file.parent):
                sha.update(file.relative_to(self.file.parent).as_posix().encode() + b"\0")
                sha.update(hashlib.sha256(file.read_bytes()).digest())
        return sha.hexdigest()

    @cached_property
    def imports(self) -> frozenset[str]:
        """The modules that running this one runs too, as far as they can be this project's."""
        return frozenset(m for m in self._imports() if m.split(".")[0] in PACKAGES)

    def _imports(self) -> Iterator[str]:
        for node in ast.walk(self.tree):
            if isinstance(node, ast.Import):
                for alias in node.names:
                    yield from _parents_and_self(alias.name)
            elif isinstance(node, ast.ImportFrom):
                base = self._absolute(node)
                for alias in node.names:
                    yield from _defining(base, alias.name)

    def _absolute(self, node: ast.ImportFrom) -> str:
        if node.level == 0:
            return node.module or ""
        parts = self.module.split(".")
        package = parts if self.is_package else parts[:-1]
        package = package[: len(package) - node.level + 1]
        return ".".join([*package, *([node.module] if node.module else [])])


def closure(script: Path) -> dict[str, str]:
    """Digest of every file that `script`'s result depends on, by its module's name."""
    start = Source(module_name(script), script)
    found: dict[str, str] = {}
    waiting = [start]
    while waiting:
        source = waiting.pop()
        name = source.module or source.file.name
        if name in found:
            continue
        found[name] = source.digest
        for module in source.imports:
            if not module.startswith(CARRIERS) and (known := _find(module)) is not None:
                waiting.append(known)
    return dict(sorted(found.items()))


@cache
def _find(module: str) -> Source | None:
    """The project's file of a module; None when it is no module of this project."""
    if module.split(".")[0] not in PACKAGES:
        return None
    path = PROJECT.joinpath(*module.split("."))
    for file in (path.with_suffix(".py"), path / "__init__.py"):
        if file.is_file():
            return Source(module, file)
    return None


def module_name(script: Path) -> str:
    """The dotted name of a file of this project; empty when it lies outside."""
    script = script.resolve()
    if not script.is_relative_to(PROJECT) or script.relative_to(PROJECT).parts[0] not in PACKAGES:
        return ""
    return ".".join(script.relative_to(PROJECT).with_suffix("").parts)


def _parents_and_self(module: str) -> Iterator[str]:
    """A module and the packages it lies in, but for those that only re-export."""
    parts = module.split(".")
    for i in range(1, len(parts)):
        if _reexports(package := ".".join(parts[:i])) is None:
            yield package
    yield module


def _defining(base: str, name: str) -> Iterator[str]:
    """What `from base import name` runs, looking through rooms that only re-export."""
    exports = _reexports(base) or {}
    if name in exports:
        yield from _defining(*exports[name])
    elif _find(f"{base}.{name}") is not None:
        yield from _parents_and_self(f"{base}.{name}")
    else:
        yield from _parents_and_self(base)


@cache
def _reexports(module: str) -> dict[str, tuple[str, str]] | None:
    """Of a room whose __init__ only re-exports: name -> (module, name there). Else None."""
    source = _find(module)
    if source is None or not source.is_package or _data_files(source.file.parent):
        return None
    names: dict[str, tuple[str, str]] = {}
    for node in source.tree.body:
        if isinstance(node, ast.ImportFrom):
            base = source._absolute(node)
            names.update({a.asname or a.name: (base, a.name) for a in node.names})
        elif not _is_all(node):
            return None
    return names


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


@cache
def _data_files(package: Path) -> tuple[Path, ...]:
    """The files of a package that are not code and belong to no package inside it."""
    files: list[Path] = []
    for path in sorted(package.iterdir()):
        if path.is_dir():
            inner = path.name != "__pycache__" and not (path / "__init__.py").is_file()
            files += _data_files(path) if inner else ()
        elif path.suffix not in (".py", ".pyc", ".md", ".typed", ".txt"):
            files.append(path)
    return tuple(files)

"""What a result depends on: its code, found without importing anything, and the content of files.

What a stage reads must stay as it is while the stage runs, or its result is of something else.
Digests before and after are not enough: a file that was changed and changed back has the same one,
but the stage may have read what was there in between. The time of a file's last change of status
cannot be set back.

From the stage's script, imports are followed through this project. A file counts by its syntax
tree without docstrings, so comments, layout and documentation don't make results stale; data files
of a package (the body model) count by their bytes. A room whose __init__ only re-exports is looked
through: importing one name of it is depending on the file that defines that name, not on all of it.

The rooms in CARRIERS are left out: they carry values and compute none.
"""

from __future__ import annotations

import ast
import hashlib
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import TypedDict

from imocap_core.artifacts.file_memory import files_below, remembered
from imocap_core.errors import WorkFailed
from imocap_core.files import sha256_of


def content_digest(path: Path) -> str:
    """SHA-256 of a file's bytes, or of a folder's files and their names in it.

    Computed again only where something has changed. WorkFailed when it can't be read.
    """
    if path.exists() and not path.is_dir() and not path.is_file():
        raise WorkFailed(f"{path}: expected a file or a folder, got something else (a pipe?)")
    try:
        return remembered("content", path, _digest)
    except OSError as error:
        raise WorkFailed(f"cannot read {error.filename or path}: {error.strerror}") from None


def _digest(path: Path) -> str:
    if not path.is_dir():
        return sha256_of(path)
    sha = hashlib.sha256()
    for relative in files_below(path):
        sha.update(relative.encode() + b"\0")
        sha.update(bytes.fromhex(_digest(path / relative)))
    return sha.hexdigest()


States = list[tuple[str, int, int, int, int]]


@contextmanager
def unchanged(reads: Mapping[str, Path]) -> Iterator[None]:
    """WorkFailed when one of these files or folders was touched while the body ran.

    reads: by what they are read as.
    """
    before = {name: _states(path) for name, path in reads.items()}
    yield
    for name, path in reads.items():
        if _states(path) != before[name]:
            raise WorkFailed(
                f"{path} ({name}) was changed while it was read; the result is not stored. Run "
                f"again when nothing writes there"
            )


def _states(path: Path) -> States:
    """Every file's name, size, inode, and times of last change; empty where there is nothing."""
    if not path.exists():
        return []
    names = files_below(path) if path.is_dir() else [""]
    of = [(name, os.stat(path / name if name else path)) for name in names]
    return [(n, s.st_size, s.st_ino, s.st_mtime_ns, s.st_ctime_ns) for n, s in of]


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


def _parse_source(file: Path, module: str, packages: Sequence[str]) -> ParsedSource:
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
            elif kind in WITH_DOCSTRING and ast.get_docstring(value, clean=False) is not None:  # type: ignore[arg-type]
                value.body = value.body[1:]  # type: ignore[attr-defined]
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
        elif not isinstance(node, ast.Assign) or ast.unparse(node.targets[0]) != "__all__":
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


PROJECT = Path(__file__).resolve().parents[2]
PACKAGES = ("imocap_core", "stages", "benchmarks")
CARRIERS = (
    "imocap_core.cli",
    "imocap_core.errors",
    "imocap_core.params",
    "imocap_core.pipeline",
    "imocap_core.workspace",
)
CODE_FORMAT = 2  # raise when what `_parse_source` returns means something else


@dataclass(frozen=True)
class SourceFile:
    """One Python file of the project (or a script outside it, with an empty module name)."""

    module: str
    file: Path

    @cached_property
    def parsed(self) -> ParsedSource:
        """Its code, imports and re-exports; parsed again only where the file has changed."""

        def parse(file: Path) -> ParsedSource:
            return _parse_source(file, self.module, PACKAGES)

        return remembered(f"source{CODE_FORMAT}:{self.module}", self.file, parse)

    @cached_property
    def digest(self) -> str:
        """Digest of its syntax tree, and of the data files when it is a package."""
        data = _data_files(self.file.parent) if self.is_package and self.module else ()
        if not data:
            return self.parsed["digest"]
        sha = hashlib.sha256(bytes.fromhex(self.parsed["digest"]))
        for file in data:
            sha.update(file.relative_to(self.file.parent).as_posix().encode() + b"\0")
            sha.update(bytes.fromhex(content_digest(file)))
        return sha.hexdigest()

    @property
    def is_package(self) -> bool:
        """Whether this is the __init__ of a package."""
        return self.file.name == "__init__.py"

    @cached_property
    def imports(self) -> frozenset[str]:
        """The modules of this project that running this one runs too."""
        return frozenset(
            module
            for base, name in self.parsed["imports"]
            for module in (_parents_and_self(base) if name is None else _defining(base, name))
        )


def closure(script: Path) -> dict[str, str]:
    """Digest of every file that `script`'s result depends on, by its module's name."""
    waiting = [SourceFile(module_name(script), script)]
    digests: dict[str, str] = {}
    while waiting:
        source = waiting.pop()
        name = source.module or source.file.name
        if name in digests:
            continue
        digests[name] = source.digest
        imported = (_find(m) for m in source.imports if not m.startswith(CARRIERS))
        waiting += [source for source in imported if source is not None]
    return dict(sorted(digests.items()))


@cache
def _find(module: str) -> SourceFile | None:
    """The project's file of a module; None when it is no module of this project."""
    if module.split(".")[0] not in PACKAGES:
        return None
    path = os.path.join(PROJECT, *module.split("."))
    for file in (f"{path}.py", os.path.join(path, "__init__.py")):
        if os.path.isfile(file):
            return SourceFile(module, Path(file))
    return None


def module_name(script: Path) -> str:
    """The dotted name of a file of this project; empty for a file outside."""
    script = script.resolve()
    if not script.is_relative_to(PROJECT) or script.relative_to(PROJECT).parts[0] not in PACKAGES:
        return ""
    return ".".join(script.relative_to(PROJECT).with_suffix("").parts)


def _parents_and_self(module: str) -> Iterator[str]:
    """A module and the packages it is in, except those that only re-export."""
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
    return source.parsed["exports"]


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

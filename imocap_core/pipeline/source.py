"""The code a stage's result depends on, found without importing anything.

From the stage's script, imports are followed through this project. A file counts by its syntax
tree without docstrings, so comments, layout and documentation don't make results stale; data files
of a package (the body model) count by their bytes. A room whose __init__ only re-exports is looked
through: importing one name of it is depending on the file that defines that name, not on all of it.

The rooms in CARRIERS are left out: they carry values and compute none.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from imocap_core.artifacts.file_memory import remembered
from imocap_core.pipeline.content import content_digest

if TYPE_CHECKING:
    from imocap_core.pipeline.source_tree import ParsedSource

PROJECT = Path(__file__).resolve().parents[2]
PACKAGES = ("imocap_core", "stages", "benchmarks")
CARRIERS = (
    "imocap_core.cli",
    "imocap_core.errors",
    "imocap_core.params",
    "imocap_core.pipeline",
    "imocap_core.workspace",
)
CODE_FORMAT = 2  # raise when what `parse_source` returns means something else


@dataclass(frozen=True)
class SourceFile:
    """One Python file of the project (or a script outside it, with an empty module name)."""

    module: str
    file: Path

    @cached_property
    def parsed(self) -> ParsedSource:
        """Its code, imports and re-exports; parsed again only where the file has changed."""

        def parse(file: Path) -> ParsedSource:
            from imocap_core.pipeline.source_tree import parse_source

            return parse_source(file, self.module, PACKAGES)

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

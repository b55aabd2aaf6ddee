"""Names that say how a value came about and not what it is are refused, classes named twice, and a
documentation or tests that have grown.

    python -m tools.check_names      # 0: clean; 1: one line a fault

Looked at is every name that is bound: assigned, looped over, imported as, an argument, a field.
"""

from __future__ import annotations

import ast
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("imocap", "imocap_core", "stages", "benchmarks", "tools")
PAGES = ("*.md", "docs/**/*.md", "benchmarks/*.md", "actions/*.md", "artifacts/*.md")
PAGES += ("imocap_core/**/*.md",)
MOST_TEST_LINES = 46_700  # of tests/**/*.py; may only fall
MOST_WORDS = 39_500  # of all pages but the changelog, as `wc -w` counts; may only fall
FILLERS = frozenset({"found", "seen", "own", "said", "told", "kept", "at", "like", "known"})


def bound_names(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """(line, name) of everything that a file binds to a name."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.alias) and node.asname:
            yield node.lineno, node.asname


def classes(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """(line, name) of the public classes of a file."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield node.lineno, node.name


def faults(files: dict[str, str]) -> list[str]:
    """One line a fault in some sources, by their paths."""
    lines = []
    defined: dict[str, list[str]] = defaultdict(list)
    for path, source in sorted(files.items()):
        tree = ast.parse(source, filename=path)
        lines += [
            f"{path}:{line}: {name!r} is a filler: name what the value is"
            for line, name in bound_names(tree)
            if name in FILLERS
        ]
        for line, name in classes(tree):
            defined[name].append(f"{path}:{line}")
    lines += [
        f"{', '.join(places)}: {len(places)} classes are called {name}: one name, one meaning"
        for name, places in sorted(defined.items())
        if len(places) > 1
    ]
    return lines


def words_of_pages(root: Path) -> int:
    """Words of the documentation but the changelog, Markdown's signs included."""
    files = {file for pattern in PAGES for file in root.glob(pattern)} - {root / "CHANGELOG.md"}
    return sum(len(file.read_text(encoding="utf-8").split()) for file in files)


def lines_of_tests(root: Path) -> int:
    """Lines of everything below tests/."""
    return sum(len(f.read_bytes().splitlines()) for f in (root / "tests").rglob("*.py"))


def main() -> int:
    files = [file for folder in FOLDERS for file in sorted((ROOT / folder).rglob("*.py"))]
    lines = faults({f.relative_to(ROOT).as_posix(): f.read_text(encoding="utf-8") for f in files})
    if (words := words_of_pages(ROOT)) > MOST_WORDS:
        lines.append(f"documentation: {words} words, at most {MOST_WORDS}: cut before you add")
    if (count := lines_of_tests(ROOT)) > MOST_TEST_LINES:
        lines.append(f"tests: {count} lines, at most {MOST_TEST_LINES}: cut before you add")
    print("\n".join(lines) if lines else f"names: {len(files)} files, no filler, no class twice")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main())

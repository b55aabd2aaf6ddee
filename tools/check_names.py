"""Names that say how a value came about and not what it is are refused, classes named twice, and
whatever has grown beyond its budget: the core, its functions, tests, documentation.

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
CORE = "imocap_core"
# They may only fall: a change that needs more room removes something.
BUDGETS = {
    "files of the core": 334,
    "lines of the core": 68_883,
    "packages of the core": 40,
    "public names of the core": 3_869,
    "lines of the core's longest function": 77,
    "arguments of a function of the core": 14,
    "functions of the core with more than 8 arguments": 11,
    "lines of the tests": 41_029,
    "words of the documentation": 37_538,  # of all pages but the changelog, as `wc -w` counts
}
MANY_ARGUMENTS = 8
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


def arguments(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """How many arguments a function takes, besides self and cls."""
    given = function.args
    named = [*given.posonlyargs, *given.args, *given.kwonlyargs]
    return sum(a.arg not in ("self", "cls") for a in named)


def public_names(tree: ast.Module) -> Iterator[str]:
    """The functions, classes and constants of a file that others may import."""
    for node in tree.body:
        bound: list[ast.expr] = []
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            bound = [ast.Name(node.name)]
        elif isinstance(node, ast.Assign):
            bound = node.targets
        elif isinstance(node, ast.AnnAssign):
            bound = [node.target]
        names = [n.id for target in bound for n in ast.walk(target) if isinstance(n, ast.Name)]
        yield from (name for name in names if not name.startswith("_"))


def measured(sources: dict[str, str]) -> dict[str, int]:
    """What of the core has a budget: by the paths of its files, and their sources."""
    trees = [ast.parse(source) for source in sources.values()]
    nodes = [node for tree in trees for node in ast.walk(tree)]
    functions = [n for n in nodes if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef)]
    counts = [arguments(f) for f in functions]
    return {
        "files of the core": len(sources),
        "lines of the core": sum(source.count("\n") for source in sources.values()),
        "packages of the core": len({path.rpartition("/")[0] for path in sources}),
        "public names of the core": sum(1 for tree in trees for _ in public_names(tree)),
        "lines of the core's longest function": max(
            ((f.end_lineno or f.lineno) - f.lineno + 1 for f in functions), default=0
        ),
        "arguments of a function of the core": max(counts, default=0),
        "functions of the core with more than 8 arguments": sum(
            count > MANY_ARGUMENTS for count in counts
        ),
    }


def lines_of_tests(root: Path) -> int:
    """Lines of everything below tests/."""
    return sum(len(f.read_bytes().splitlines()) for f in (root / "tests").rglob("*.py"))


def overruns(sources: dict[str, str], **others: int) -> list[str]:
    """One line for every budget that is overrun; others: sizes outside the core, by their names
    with underscores."""
    sizes = measured(sources) | {name.replace("_", " "): size for name, size in others.items()}
    return [
        f"{what}: {size:,}, at most {BUDGETS[what]:,}: cut before you add"
        for what, size in sizes.items()
        if size > BUDGETS[what]
    ]


def main() -> int:
    files = [file for folder in FOLDERS for file in sorted((ROOT / folder).rglob("*.py"))]
    sources = {f.relative_to(ROOT).as_posix(): f.read_text(encoding="utf-8") for f in files}
    core = {path: source for path, source in sources.items() if path.startswith(f"{CORE}/")}
    words, tests = words_of_pages(ROOT), lines_of_tests(ROOT)
    lines = faults(sources)
    lines += overruns(core, words_of_the_documentation=words, lines_of_the_tests=tests)
    print("\n".join(lines) if lines else f"names: {len(files)} files, no filler, no class twice")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main())

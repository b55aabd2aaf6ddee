"""The rule on names sees what it is to see, and the project keeps it; so do the contracts on
imports."""

import shutil
import subprocess
import sys
import tomllib
from graphlib import TopologicalSorter
from pathlib import Path

import grimp
import pytest

from tools.check_names import BUDGETS, FILLERS, faults, main, measured, overruns, words_of_pages


@pytest.mark.parametrize(
    "source",
    [
        "{} = 1\n",
        "for {} in ():\n    pass\n",
        "def f({}):\n    pass\n",
        "def f(*, {}=1):\n    pass\n",
        "x = lambda {}: 1\n",
        "class A:\n    {}: int\n",
        "with open('x') as {}:\n    pass\n",
        "import numpy as {}\n",
        "y = [{} for {} in ()]\n",
        "if ({} := 1):\n    pass\n",
    ],
)
def test_a_filler_is_seen_wherever_it_is_bound(source: str) -> None:
    for filler in sorted(FILLERS):
        assert len(faults({"a.py": source.replace("{}", filler)})) == 1
        assert faults({"a.py": source.replace("{}", f"{filler}_px")}) == []


def test_reading_a_name_is_no_fault() -> None:
    assert faults({"a.py": "x = pandas.at[found.seen]\n"}) == []


def test_one_class_name_has_one_meaning() -> None:
    twice = {"a.py": "class Take:\n    pass\n", "b.py": "class Take:\n    pass\n"}
    assert faults(twice) == ["a.py:1, b.py:1: 2 classes are called Take: one name, one meaning"]
    private = {path: source.replace("Take", "_Take") for path, source in twice.items()}
    assert faults(private) == []


def test_every_page_counts_once_but_not_the_changelog(tmp_path: Path) -> None:
    (tmp_path / "docs").mkdir()
    for page in ("README.md", "CHANGELOG.md", "docs/sync.md", "docs/picture.txt"):
        (tmp_path / page).write_text("# One page\n\n| a |\n")
    assert words_of_pages(tmp_path) == 2 * 6


def test_the_core_is_measured_by_what_one_has_to_read() -> None:
    wide = "def f(self, a, b=1, *, c, d=2):\n    def inner():\n        return a\n    return inner\n"
    sources = {
        "imocap_core/a.py": f"LIMIT, _HIDDEN = 1, 2\n\n\n{wide}",
        "imocap_core/b/c.py": "class Take:\n    size = 0\n\n    def of(self, a):\n        pass\n",
    }
    assert measured(sources) == {
        "files of the core": 2,
        "lines of the core": 12,
        "packages of the core": 2,
        "public names of the core": 3,
        "lines of the core's longest function": 4,
        "arguments of a function of the core": 4,
        "functions of the core with more than 8 arguments": 0,
    }


def test_only_what_is_beyond_its_budget_is_a_fault() -> None:
    most = BUDGETS["words of the documentation"]
    assert overruns({}, words_of_the_documentation=most) == []
    (fault,) = overruns({}, words_of_the_documentation=most + 1)
    assert fault.startswith(f"words of the documentation: {most + 1:,}, at most {most:,}")
    nine = ", ".join(f"a{k}" for k in range(9))
    many = {f"{k}.py": f"def f({nine}):\n    pass\n" for k in range(20)}
    (fault,) = overruns(many)
    assert fault.startswith("functions of the core with more than 8 arguments: 20")


@pytest.mark.long  # as `make lint` says
def test_the_project_keeps_the_rule() -> None:
    assert main() == 0


ROOT = Path(__file__).resolve().parents[2]
LINT = [sys.executable, "-c", "from importlinter.cli import lint_imports_command as c; c()"]
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]


def named_modules() -> list[str]:
    """Every module of this project that the contracts name, packages before what is in them."""
    names = set(SETTINGS["root_packages"])
    for contract in SETTINGS["contracts"]:
        for line in contract.get("layers", []):
            names |= set(line.replace("|", " ").replace(":", " ").replace("(", " ").split())
        names |= {*contract.get("source_modules", []), *contract.get("forbidden_modules", [])}
    names = {name.strip(")") for name in names}
    return sorted(n for n in names if n.split(".")[0] in SETTINGS["root_packages"])


@pytest.mark.parametrize(
    ("importer", "imported", "contract"),
    [
        ("imocap_core.figures", "imocap_core.io", None),
        ("imocap_core.body", "imocap_core.sync", "Each room imports only from those below it"),
        ("imocap_core.rotations", "imocap_core.body", "Each room imports only from those below"),
        (
            "imocap_core.sync.comparable_poses",
            "imocap_core.sync.warp",
            "Synchronisation: each subroom",
        ),
        ("imocap_core.sync", "imocap_core.io", "Pure rooms never import boundary rooms"),
        ("imocap_core.camera", "yaml", "Pure rooms do no input or output of their own"),
        ("imocap_core.artifacts", "stages", "The core never imports the stages"),
        ("imocap_core.artifacts", "benchmarks", "The core never imports the stages"),
        ("imocap_core.detect.workers", "imocap_core.body", "What runs in a separate environment"),
    ],
)
def test_a_wrong_arrow_is_seen(tmp_path, importer, imported, contract):
    for module in named_modules():
        folder = tmp_path.joinpath(*module.split("."))
        folder.mkdir(parents=True, exist_ok=True)
        for package in [folder, *folder.parents][: module.count(".") + 1]:
            (package / "__init__.py").touch()
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    (tmp_path.joinpath(*importer.split(".")) / "__init__.py").write_text(f"import {imported}\n")
    done = subprocess.run(
        [*LINT, "--no-cache"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    if contract is None:
        assert done.returncode == 0, done.stdout
    else:
        assert done.returncode == 1
        assert any(contract in line and "BROKEN" in line for line in done.stdout.splitlines())


def test_no_import_closes_a_circle() -> None:
    graph = grimp.build_graph(*SETTINGS["root_packages"], cache_dir=None)
    arrows = {m: graph.find_modules_directly_imported_by(m) for m in graph.modules}
    assert len(list(TopologicalSorter(arrows).static_order())) >= len(arrows)

"""The contract on import arrows breaks when an arrow points the wrong way; no circle is left."""

import shutil
import subprocess
import sys
import tomllib
from graphlib import TopologicalSorter
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).resolve().parents[2]
LINT = [sys.executable, "-c", "from importlinter.cli import lint_imports_command as c; c()"]
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]


def lint(folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*LINT, "--no-cache"], cwd=folder, capture_output=True, text=True, check=False
    )


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
    done = lint(tmp_path)
    if contract is None:
        assert done.returncode == 0, done.stdout
    else:
        assert done.returncode == 1
        assert any(contract in line and "BROKEN" in line for line in done.stdout.splitlines())


def test_no_import_closes_a_circle() -> None:
    graph = grimp.build_graph(*SETTINGS["root_packages"], cache_dir=None)
    arrows = {m: graph.find_modules_directly_imported_by(m) for m in graph.modules}
    assert len(list(TopologicalSorter(arrows).static_order())) >= len(arrows)

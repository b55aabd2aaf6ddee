"""The contract on import arrows breaks when an arrow points the wrong way."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
ROOMS = (
    *("body", "camera", "render", "sync", "baselines", "motion", "hands"),
    *("metrics", "synthetic", "people", "lifter", "technique"),
    *("artifacts", "formats", "views"),
)
DETECT = ("stages/detect", "stages/detect/workers")
LINT = [sys.executable, "-c", "from importlinter.cli import lint_imports_command as c; c()"]


def lint(folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*LINT, "--no-cache"], cwd=folder, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize(
    ("importer", "imported", "contract"),
    [
        ("imocap_core.views", "imocap_core.formats", None),
        ("imocap_core.body", "imocap_core.sync", "Each room imports only from those before it"),
        ("imocap_core.rotations", "imocap_core.body", "Each room imports only from those before"),
        ("imocap_core.sync", "imocap_core.formats", "Pure rooms never import boundary rooms"),
        ("imocap_core.camera", "yaml", "Pure rooms do no input or output of their own"),
        ("imocap_core.artifacts", "stages", "The core never imports the stages"),
        ("stages.detect.workers", "imocap_core.body", "What runs in a detector's own environment"),
    ],
)
def test_a_wrong_arrow_is_seen(
    tmp_path: Path, importer: str, imported: str, contract: str | None
) -> None:
    packages = ("imocap_core", "stages", *DETECT, *(f"imocap_core/{room}" for room in ROOMS))
    for package in packages:
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").touch()
    for module in ("rotations", "conventions", "alignment", "workers"):
        (tmp_path / "imocap_core" / f"{module}.py").touch()
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    place = tmp_path.joinpath(*importer.split("."))
    file = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
    file.write_text(f"import {imported}\n")
    done = lint(tmp_path)
    if contract is None:
        assert done.returncode == 0, done.stdout
    else:
        assert done.returncode == 1
        assert any(contract in line and "BROKEN" in line for line in done.stdout.splitlines())

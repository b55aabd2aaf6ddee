"""The Python that a detector runs in: an environment apart, `.venv-detect`, made when needed.

Detectors want versions of packages that this program does not, so they get their own, pinned in
stages/detect/environments. IMOCAP_DETECT_PYTHON names another Python that has them.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from imocap_core.errors import WorkFailed
from imocap_core.pipeline.source import PROJECT

VARIABLE = "IMOCAP_DETECT_PYTHON"
FOLDER = ".venv-detect"
VERSIONS = ((3, 11), (3, 12))  # for which all packages have wheels
Say = Callable[[str], None]


def python_for(packages: Path, root: Path, say: Say) -> Path:
    """The Python of the environment that holds `packages` (a list with versions).

    It is looked for in `root`, the folders above it and the checkout, and made, or brought up to
    date, in the checkout or else in `root`. WorkFailed, one sentence, when that fails.
    """
    named = os.environ.get(VARIABLE)
    if named:
        if shutil.which(named) is None:
            raise WorkFailed(f"{VARIABLE}: there is no program {named}; name a Python, or unset it")
        return Path(named)
    home = PROJECT if (PROJECT / "pyproject.toml").is_file() else root.resolve()
    places = (home, *root.resolve().parents, root.resolve())
    folder = next((p / FOLDER for p in places if (p / FOLDER).is_dir()), home / FOLDER)
    if not _holds(folder, packages):
        _make(folder, packages, say)
    return _python(folder)


def _python(folder: Path) -> Path:
    return folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def _stamp(folder: Path, packages: Path) -> Path:
    return folder / f".installed-{packages.name}"


def _holds(folder: Path, packages: Path) -> bool:
    stamp = _stamp(folder, packages)
    return stamp.is_file() and stamp.read_bytes() == packages.read_bytes()


def _make(folder: Path, packages: Path, say: Say) -> None:
    if not _python(folder).exists():
        say(f"making {folder}")
        _run([str(_base()), "-m", "venv", str(folder)], folder, packages)
    say(f"installing {packages.stem} into {folder} (once, about 100 MB)")
    pip = [str(_python(folder)), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    _run([*pip, "--no-deps", "-r", str(packages)], folder, packages)
    _stamp(folder, packages).write_bytes(packages.read_bytes())


def _base() -> Path:
    """A Python that the packages exist for: this one, or another on the path."""
    if sys.version_info[:2] in VERSIONS:
        return Path(sys.executable)
    found = (shutil.which(f"python{major}.{minor}") for major, minor in VERSIONS)
    python = next((path for path in found if path), None)
    if python is None:
        raise WorkFailed(
            f"detection needs Python 3.11 or 3.12 beside this {sys.version_info.major}."
            f"{sys.version_info.minor}: install one, or name it with {VARIABLE}"
        )
    return Path(python)


def _run(words: list[str], folder: Path, packages: Path) -> None:
    """Run an installer; one sentence when it fails."""
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        lines = (done.stderr or done.stdout).strip().splitlines()
        said = next((line for line in lines if "ERROR" in line), lines[-1] if lines else "nothing")
        raise WorkFailed(
            f"cannot make {folder}, where {packages.stem} is to run: {said[:200]}. Connect to the "
            f"network and run `make detect-env` once, or name a Python that has {packages.stem} "
            f"with {VARIABLE}"
        )

"""The Python that a detector runs in: a separate environment, `.venv-detect`, made when needed.

Detectors need other versions of packages than this program. They are pinned in
imocap_core/detect/environments. IMOCAP_DETECT_PYTHON names another Python that has them.

An environment is a program. It is looked for in the checkout, or, where this program is installed,
in the user's cache folder, and never in a working folder, which may come from somebody else.
"""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from imocap_core.errors import WorkFailed
from imocap_core.pipeline.source import PROJECT

VARIABLE = "IMOCAP_DETECT_PYTHON"
FOLDER = ".venv-detect"
VERSIONS = ((3, 11), (3, 12))  # Python versions with wheels of all packages
MODULE = ("-P", "-m")  # and nothing from the working folder, which may be somebody else's
Announce = Callable[[str], None]


def python_for(packages: Path, announce: Announce) -> Path:
    """The Python of the environment with `packages` (a file that lists them with versions).

    It is made or updated when needed; `announce` is called before each slow step. WorkFailed when
    that fails, or when others than this user can change the environment.
    """
    named = os.environ.get(VARIABLE)
    if named:
        if shutil.which(named) is None:
            raise WorkFailed(
                f"{VARIABLE}: the program {named} does not exist; name a Python, or unset it"
            )
        return Path(named)
    folder = environment_folder()
    _must_be_private(folder)
    if not _is_installed(folder, packages):
        _make(folder, packages, announce)
    return _python(folder)


def is_available(packages: Path) -> bool:
    """Whether `python_for` would make nothing."""
    return bool(os.environ.get(VARIABLE)) or _is_installed(environment_folder(), packages)


def environment_folder() -> Path:
    """The environment's folder, which need not exist: in the checkout, or in the user's cache."""
    if (PROJECT / "pyproject.toml").is_file():
        return PROJECT / FOLDER
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(cache) / "imocap" / FOLDER


def _must_be_private(folder: Path) -> None:
    """WorkFailed when others than this user (or root) can change the environment's program."""
    if os.name != "posix" or not folder.is_dir():
        return
    for path in (folder, _python(folder).parent, _python(folder).resolve()):
        if path.exists() and not _is_private(path.stat()):
            raise WorkFailed(
                f"{path} belongs to another user, or others can write to it: it is not run. Remove "
                f"{folder} to have it made again, or name a Python that you trust with {VARIABLE}"
            )


def _is_private(status: os.stat_result) -> bool:
    return status.st_uid in (0, os.geteuid()) and not status.st_mode & stat.S_IWOTH


def _python(folder: Path) -> Path:
    return folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def _stamp(folder: Path, packages: Path) -> Path:
    return folder / f".installed-{packages.name}"


def _is_installed(folder: Path, packages: Path) -> bool:
    stamp = _stamp(folder, packages)
    return stamp.is_file() and stamp.read_bytes() == packages.read_bytes()


def _make(folder: Path, packages: Path, announce: Announce) -> None:
    if not _python(folder).exists():
        announce(f"making {folder}")
        folder.parent.mkdir(parents=True, exist_ok=True)
        _run([str(_base()), *MODULE, "venv", str(folder)], folder, packages)
    announce(f"installing {packages.stem} into {folder} (once, about 100 MB)")
    pip = [str(_python(folder)), *MODULE, "pip", "install", "--no-deps", "-r", str(packages)]
    _run([*pip, "--quiet", "--disable-pip-version-check"], folder, packages)
    _stamp(folder, packages).write_bytes(packages.read_bytes())


def _base() -> Path:
    """A Python with wheels of the packages: this one, or another on the path."""
    if sys.version_info[:2] in VERSIONS:
        return Path(sys.executable)
    candidates = (shutil.which(f"python{major}.{minor}") for major, minor in VERSIONS)
    python = next((path for path in candidates if path), None)
    if python is None:
        raise WorkFailed(
            f"detection needs Python 3.11 or 3.12 beside this {sys.version_info.major}."
            f"{sys.version_info.minor}: install one, or name it with {VARIABLE}"
        )
    return Path(python)


def _run(words: list[str], folder: Path, packages: Path) -> None:
    """Run an installer; WorkFailed with its error message when it fails."""
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        lines = (done.stderr or done.stdout).strip().splitlines()
        message = next(
            (line for line in lines if "ERROR" in line), lines[-1] if lines else "nothing"
        )
        raise WorkFailed(
            f"cannot make {folder} for {packages.stem}: {message[:200]}. Connect to the network, "
            f"run `make detect-env` once, or name a Python that has {packages.stem} with {VARIABLE}"
        )

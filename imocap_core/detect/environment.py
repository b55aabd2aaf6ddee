"""The Python of a separate environment, made when needed: detectors', `.venv-detect`, and others.

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
from dataclasses import dataclass
from pathlib import Path

from imocap_core.errors import WorkFailed
from imocap_core.pipeline.source import PROJECT

MODULE = ("-P", "-m")  # and nothing from the working folder, which may be somebody else's
Announce = Callable[[str], None]


@dataclass(frozen=True)
class Environment:
    """A separate environment.

    purpose: what needs it. variable: of the system's environment, names another Python instead.
    folder: its name. versions: of Python with wheels of all packages. size: of the download. offer:
    what to do where it cannot be made.
    """

    purpose: str
    variable: str
    folder: str
    versions: tuple[tuple[int, int], ...]
    size: str
    offer: str


DETECTION = Environment(
    purpose="detection",
    variable="IMOCAP_DETECT_PYTHON",
    folder=".venv-detect",
    versions=((3, 11), (3, 12)),
    size="some 320 MB fetched, 360 MB on the disk",
    offer="run `imocap detect --setup` once",
)
FOLDER = DETECTION.folder


def python_for(packages: Path, announce: Announce, kind: Environment = DETECTION) -> Path:
    """The Python of the environment with `packages` (a file that lists them with versions).

    It is made or updated when needed; `announce` is called before each slow step. WorkFailed when
    that fails, or when others than this user can change the environment.
    """
    named = os.environ.get(kind.variable)
    if named:
        if shutil.which(named) is None:
            raise WorkFailed(
                f"{kind.variable}: the program {named} does not exist; name a Python, or unset it"
            )
        return Path(named)
    folder = environment_folder(kind)
    _must_be_private(folder, kind)
    if not _is_installed(folder, packages):
        _make(folder, packages, announce, kind)
    return _python(folder)


def is_available(packages: Path, kind: Environment = DETECTION) -> bool:
    """Whether `python_for` would make nothing."""
    return bool(os.environ.get(kind.variable)) or _is_installed(environment_folder(kind), packages)


def environment_folder(kind: Environment = DETECTION) -> Path:
    """The environment's folder, which need not exist: in the checkout, or in the user's cache."""
    if (PROJECT / "pyproject.toml").is_file():
        return PROJECT / kind.folder
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(cache) / "imocap" / kind.folder


def _must_be_private(folder: Path, kind: Environment) -> None:
    """WorkFailed when others than this user (or root) can change the environment's program."""
    if os.name != "posix" or not folder.is_dir():
        return
    for path in (folder, _python(folder).parent, _python(folder).resolve()):
        if path.exists() and not _is_private(path.stat()):
            raise WorkFailed(
                f"{path} belongs to another user, or others can write to it: it is not run. Remove "
                f"{folder} to have it made again, or name a Python that you trust with "
                f"{kind.variable}"
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


def _make(folder: Path, packages: Path, announce: Announce, kind: Environment) -> None:
    if not _python(folder).exists():
        announce(f"making {folder}")
        folder.parent.mkdir(parents=True, exist_ok=True)
        _run([str(_base(kind)), *MODULE, "venv", str(folder)], folder, packages, kind)
    announce(f"installing {packages.stem} into {folder} (once, {kind.size})")
    pip = [str(_python(folder)), *MODULE, "pip", "install", "--no-deps", "-r", str(packages)]
    _run([*pip, "--quiet", "--disable-pip-version-check"], folder, packages, kind)
    _stamp(folder, packages).write_bytes(packages.read_bytes())


def _base(kind: Environment) -> Path:
    """A Python with wheels of the packages: this one, or another on the path."""
    if sys.version_info[:2] in kind.versions:
        return Path(sys.executable)
    candidates = (shutil.which(f"python{major}.{minor}") for major, minor in kind.versions)
    python = next((path for path in candidates if path), None)
    if python is None:
        fit = " or ".join(f"{major}.{minor}" for major, minor in kind.versions)
        raise WorkFailed(
            f"{kind.purpose} needs Python {fit} beside this {sys.version_info.major}."
            f"{sys.version_info.minor}: install one, or name it with {kind.variable}"
        )
    return Path(python)


def _run(words: list[str], folder: Path, packages: Path, kind: Environment) -> None:
    """Run an installer; WorkFailed with its error message when it fails."""
    done = subprocess.run(words, capture_output=True, text=True, errors="replace", check=False)
    if done.returncode != 0:
        lines = (done.stderr or done.stdout).strip().splitlines()
        message = next(
            (line for line in lines if "ERROR" in line), lines[-1] if lines else "nothing"
        )
        raise WorkFailed(
            f"cannot make {folder} for {packages.stem}: {message[:200]}. Connect to the network, "
            f"{kind.offer}, or name a Python that has {packages.stem} with {kind.variable}"
        )

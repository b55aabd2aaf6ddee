"""`make test` on other Pythons:  python tools/other_pythons.py 3.12 3.13 (make test-pythons).

Each gets its own environment, .venv-3.12. A Python that is not here, or whose packages cannot be
had within the seconds given, is skipped in a line: on Linux torch brings gigabytes for graphics
cards. Exit code 1 when a test fails on one of them.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

# The packages' bytecode is not compiled ahead: a third of the installation, and most is never used.
INSTALL = ("setup", "PIP_FLAGS=--no-compile")
VERSION = "import ensurepip, sys, venv; print('%d.%d' % sys.version_info[:2])"


def interpreter(version: str) -> Path | None:
    """A Python of this version: python3.12 on the path, or the newest that pyenv has installed.

    pyenv's own python3.12 on the path fails where that version is not activated.
    """
    on_path = shutil.which(f"python{version}")
    pyenv = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv")
    installed = sorted(pyenv.glob(f"versions/{version}.*/bin/python"), key=_patch, reverse=True)
    candidates = [Path(on_path)] if on_path else []
    return next((path for path in [*candidates, *installed] if _runs(path, version)), None)


def _patch(path: Path) -> int:
    digits = path.parent.parent.name.rpartition(".")[2]
    return int(digits) if digits.isdecimal() else -1


def _runs(path: Path, version: str) -> bool:
    try:
        tried = subprocess.run([path, "-c", VERSION], capture_output=True, text=True, check=False)
    except OSError:
        return False
    return tried.returncode == 0 and tried.stdout.strip() == version


def make(target: Sequence[str], python: Path, version: str, seconds: float | None = None) -> str:
    """Make a target in that Python's environment; what went wrong, or an empty string."""
    line = ["make", "--no-print-directory", *target, f"PYTHON={python}", f"VENV=.venv-{version}"]
    process = subprocess.Popen(line, start_new_session=True)
    try:
        code = process.wait(seconds)
        return f"ended with exit code {code}" if code else ""
    except subprocess.TimeoutExpired:
        return f"took longer than {seconds:g} s"
    finally:
        if process.poll() is None:  # out of time, or Ctrl-C
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def main(arguments: Sequence[str] | None = None) -> int:
    """Install for all of them at the same time, then test them one after another."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("versions", nargs="+", help="such as 3.12")
    parser.add_argument("--install-seconds", type=float, default=900, help="of each, at most")
    given = parser.parse_args(arguments)
    pythons = {version: interpreter(version) for version in given.versions}
    with ThreadPoolExecutor(len(pythons)) as pool:
        installed = {
            version: pool.submit(make, INSTALL, python, version, given.install_seconds)
            for version, python in pythons.items()
            if python is not None
        }
    failed = False
    for version, python in pythons.items():
        if python is None:
            print(f"imocap: skipped Python {version}, which is not here", flush=True)
        elif fault := installed[version].result():
            shutil.rmtree(f".venv-{version}", ignore_errors=True)  # gigabytes
            print(f"imocap: skipped Python {version}: its installation {fault}", flush=True)
        else:
            print(f"imocap: the tests on Python {version}", flush=True)
            failed |= bool(make(["test"], python, version))
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())

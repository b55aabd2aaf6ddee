"""The tests of our files in other programs:  python tools/readers.py [NAME...] (make test-readers).

Each group of readers gets an environment of its own below .venv-readers, and the variable by which
its tests find it. One that cannot be installed within the seconds given is named, and its tests
are skipped with a reason. Exit code 1 when a test fails. 1.5 GB in all: `make test-all` skips
these tests unless a variable names a reader; CI has the small group.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / ".venv-readers"


@dataclass(frozen=True)
class Readers:
    """A group of readers.

    variable: names their program to the tests. packages: arguments of pip. program: in the
    environment. tests: the files that use them.
    """

    variable: str
    packages: tuple[str, ...]
    tests: tuple[str, ...]
    program: str = "python"


BPY = "imocap_core/export/bpy.txt"
GROUPS = {
    "blender": Readers(
        "IMOCAP_BLENDER",
        ("--no-deps", "-r", BPY),
        ("tests/io/test_blender.py", "tests/examples", "tests/export/test_formats.py"),
    ),
    "scenes": Readers(
        "IMOCAP_READERS",
        ("ufbx==0.0.5", "usd-core==26.11", "numpy==2.4.6"),
        ("tests/io/test_blender.py",),
    ),
    "c3d": Readers("IMOCAP_C3D", ("ezc3d==1.7.2", "c3d", "numpy"), ("tests/io/test_c3d.py",)),
    "opensim": Readers(
        "IMOCAP_OPENSIM", ("opensim==4.6.*", "numpy"), ("tests/export/test_opensim.py",)
    ),
    "rerun": Readers(
        "IMOCAP_RERUN", ("rerun-sdk==0.41.*",), ("tests/io/test_foxglove.py",), "rerun"
    ),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Install, test, say what was left out."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=list(GROUPS), help=", ".join(GROUPS))
    parser.add_argument("--install-seconds", type=float, default=900, help="of each, at most")
    given = parser.parse_args(arguments)
    wrong = [name for name in given.names if name not in GROUPS]
    if wrong:
        parser.error(f"no readers {wrong[0]}; there are: {', '.join(GROUPS)}")
    variables, tests = {}, []
    for name in given.names:
        readers = GROUPS[name]
        fault = "" if readers.variable in os.environ else install(name, given.install_seconds)
        if fault:
            print(f"{name}: left out, {fault}")
            continue
        variables[readers.variable] = os.environ.get(readers.variable, str(program(name)))
        tests += [test for test in readers.tests if test not in tests]
    if not tests:
        print("no reader can be had here, nothing was tested")
        return 0
    line = [sys.executable, "-m", "pytest", "-q", *tests]
    return subprocess.run(line, cwd=ROOT, env={**os.environ, **variables}, check=False).returncode


def program(name: str) -> Path:
    """The program that the tests start."""
    folder = "Scripts" if os.name == "nt" else "bin"
    return FOLDER / name / folder / GROUPS[name].program


def install(name: str, seconds: float) -> str:
    """Make the environment of a group of readers; what went wrong, or an empty string."""
    stamp = FOLDER / name / ".installed"
    wanted = "\n".join(_listed(word) for word in GROUPS[name].packages)
    if stamp.is_file() and stamp.read_text() == wanted:
        return ""
    python = program(name).with_name("python")
    for line in (
        [sys.executable, "-m", "venv", str(FOLDER / name)],
        [str(python), "-m", "pip", "install", "--quiet", *GROUPS[name].packages],
    ):
        try:
            done = subprocess.run(
                line, cwd=ROOT, capture_output=True, text=True, check=False, timeout=seconds
            )
        except subprocess.TimeoutExpired:
            return f"its installation took longer than {seconds:g} s"
        if done.returncode:
            lines = [*done.stderr.splitlines(), f"exit code {done.returncode}"]
            return next((line for line in lines if "ERROR" in line), lines[-1])
    stamp.write_text(wanted)
    return ""


def _listed(word: str) -> str:
    """An argument of pip, or the content of the list of packages that it names."""
    file = ROOT / word
    return file.read_text(encoding="utf-8") if file.is_file() else word


if __name__ == "__main__":
    sys.exit(main())

"""Blender, which runs scripts for us: as a program, or as Python's module `bpy`.

Blender is under the GPL and no part of this program: it has an environment of its own,
`.venv-blender`, which is made when first needed, and gets files. IMOCAP_BLENDER names another
Blender, or a Python that has `bpy`.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

from imocap_core.detect.environment import MODULE, Announce, Environment, is_available, python_for
from imocap_core.errors import WorkFailed

HERE = Path(__file__).parent
BLENDER = Environment(
    purpose="Blender's module bpy",
    variable="IMOCAP_BLENDER",
    folder=".venv-blender",
    versions=((3, 11),),
    size="about 400 MB",
    offer="name a Blender that you have",
)
LONGEST_S = 3600.0


def blender_program(announce: Announce) -> Path:
    """The Blender or Python to run scripts in; it is installed when there is none, and `announce`
    is called before. WorkFailed when that fails."""
    return python_for(HERE / "bpy.txt", announce, BLENDER)


def is_installed() -> bool:
    """Whether `blender_program` would install nothing."""
    return is_available(HERE / "bpy.txt", BLENDER)


def command(program: Path, script: Path, *words: str) -> list[str]:
    """The command line that runs a script with arguments, after `--` in its `sys.argv`."""
    if program.stem.lower().startswith("blender"):
        options = ["--background", "--factory-startup", "--python-exit-code", "1", "--python"]
        return [str(program), *options, str(script), "--", *words]
    return [str(program), MODULE[0], str(script), "--", *words]


def run_in_blender(program: Path, script: Path, *words: str) -> None:
    """Run a script to its end; WorkFailed with the last line of its output when it fails."""
    try:
        done = subprocess.run(
            command(program, script, *words),
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
            timeout=LONGEST_S,
        )
    except OSError as error:
        raise WorkFailed(f"cannot start {program}: {error.strerror}") from None
    except subprocess.TimeoutExpired:
        raise WorkFailed(f"{program} did not end within {LONGEST_S / 3600:.0f} h") from None
    if done.returncode != 0:
        lines = (done.stderr.strip() or done.stdout.strip()).splitlines()
        message = lines[-1][:300] if lines else f"exit code {done.returncode}"
        raise WorkFailed(
            f"{program} failed: {message}. {BLENDER.variable} must name a Blender, or a Python "
            f"that has its module bpy, of version 4.2 or newer"
        )

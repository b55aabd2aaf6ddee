"""FBX and USD by way of Blender, a separate program in an environment of its own.

Blender, which runs scripts for us: as a program, or as Python's module `bpy`. Blender is under the
GPL and no part of this program: it has an environment of its own, `.venv-blender`, which is made
when first needed, and gets files. IMOCAP_BLENDER names another Blender, or a Python that has `bpy`.
"""

from __future__ import annotations

import json
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from imocap_core.detect.environment import MODULE, Announce, Environment, is_available, python_for
from imocap_core.errors import WorkFailed
from imocap_core.io.writers.gltf import Actor, write_glb

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


FORMATS = ("fbx", "usd")


def write_characters(
    program: Path,
    folder: Path,
    actors: Sequence[Actor],
    ending: str,
    notes: Mapping[str, Any],
    up: str = "y",
) -> list[Path]:
    """Write `<id>.<ending>` of every actor, fbx or usd; WorkFailed when Blender fails.

    FBX is in centimetres, the unit of the programs that read it, without any node scaled by 100;
    USD is in metres. Both are y up, USD z up where asked. The actors are in a world with y up.
    """
    with tempfile.TemporaryDirectory() as scratch:
        jobs: list[dict[str, Any]] = []
        for actor in actors:
            name = actor.clip.id
            glb = Path(scratch) / f"{name}.glb"
            write_glb(glb, [actor], notes)
            out = folder / f"{name}.{ending}"
            job = {"glb": str(glb), "out": str(out), "name": name, "fps": actor.clip.fps}
            jobs.append({**job, "cm": ending == "fbx", "up": up})
        listed = Path(scratch) / "jobs.json"
        listed.write_text(json.dumps(jobs), encoding="utf-8")
        run_in_blender(program, HERE / "blender_script.py", str(listed))
    return [Path(job["out"]) for job in jobs]

"""Characters as FBX and USD: our GLB, converted by Blender, a file for each."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from imocap_core.export.blender.program import HERE, run_in_blender
from imocap_core.io.writers.gltf_scene import Actor, write_glb

FORMATS = ("fbx", "usd")


@dataclass(frozen=True)
class Target:
    """A kind of file that Blender writes. ending: fbx or usd. up: y, or of USD z."""

    ending: str
    up: str = "y"


def write_characters(
    program: Path, folder: Path, actors: Sequence[Actor], target: Target, notes: Mapping[str, Any]
) -> list[Path]:
    """Write `<id>.<ending>` of every actor; WorkFailed when Blender fails.

    FBX is in centimetres, the unit of the programs that read it, without any node scaled by 100;
    USD is in metres. Both are y up, USD z up where asked. The actors are in a world with y up.
    """
    with tempfile.TemporaryDirectory() as scratch:
        jobs: list[dict[str, Any]] = []
        for actor in actors:
            name = actor.clip.id
            glb = Path(scratch) / f"{name}.glb"
            write_glb(glb, [actor], notes)
            out = folder / f"{name}.{target.ending}"
            job = {"glb": str(glb), "out": str(out), "name": name, "fps": actor.clip.fps}
            jobs.append({**job, "cm": target.ending == "fbx", "up": target.up})
        listed = Path(scratch) / "jobs.json"
        listed.write_text(json.dumps(jobs), encoding="utf-8")
        run_in_blender(program, HERE / "scripts" / "convert.py", str(listed))
    return [Path(job["out"]) for job in jobs]

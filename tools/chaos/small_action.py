"""A small action on disk, and the command line on it as processes of their own."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import yaml

from imocap_core.artifacts.store import Store
from imocap_core.pipeline.graph import read_pipeline
from imocap_core.pipeline.source import PROJECT
from tests.report.made import FPS, SIZE, Made

NAME = "serve"
QUICK = {
    "initial_smpl.library_poses": 60,
    "initial_smpl.library_directions": 12,
    "initial_smpl.starts": 1,
    "initial_smpl.max_steps": 2,
    "initial_smpl.hypotheses": 1,
    "sync.consensus_rounds": 1,
    "motion.rounds": 1,
    "motion.max_steps": 2,
    "refine.max_rounds": 1,
    "evaluate.figures": False,
}
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
STAGES = list(read_pipeline(PROJECT / "pipeline.yaml").stages)
STAYS = (".lock", ".cache", ".made.json")  # hidden files and folders that belong there


def quick() -> list[tuple[str, str, object]]:
    """Groups of parameters, names in them, and values with which a made action is quick."""
    return [(*path.split("."), value) for path, value in QUICK.items()]


def sets(start: str = "") -> list[str]:
    """The same as words of the command line; of the paths that start so."""
    every = ((path, json.dumps(value)) for path, value in QUICK.items() if path.startswith(start))
    return [word for path, value in every for word in ("--set", f"{path}={value}")]


Part = dict[str, object]  # of the record


@dataclass(frozen=True)
class SmallAction:
    """A working folder with one action of two videos' keypoints, and what an undisturbed run of it
    gives: the digest of every stage's result, and of every file of the action."""

    root: Path
    expected: dict[str, str] = field(default_factory=dict)
    inputs: dict[str, str] = field(default_factory=dict)

    @property
    def artifacts(self) -> Path:
        """Where results are stored."""
        return self.root / "artifacts"

    @classmethod
    def make(cls, root: Path) -> SmallAction:
        """Write the action, and run it."""
        made = Made(count=2, frames=16)
        folder = root / "actions" / NAME
        videos = []
        for v, name in enumerate(made.ids):
            made.write_openpose(folder / name, v)
            fields = {"format": "openpose", "layout": "body25", "fps": FPS, "size": list(SIZE)}
            videos.append({"id": name, "keypoints": name, **fields})
        (folder / "action.yaml").write_text(yaml.safe_dump({"name": NAME, "videos": videos}))
        cls(root).finish("run")
        return cls.of(root)

    @classmethod
    def of(cls, root: Path) -> SmallAction:
        """The action of a working folder in which it has been run undisturbed."""
        action = cls(root)
        action.expected.update(action.results())
        action.inputs.update(digests_below(root / "actions" / NAME))
        assert len(action.expected) == len(STAGES)
        return action

    def add_bad_video(self) -> None:
        """Declare a third video, whose size its keypoints contradict."""
        file = self.root / "actions" / NAME / "action.yaml"
        content = yaml.safe_load(file.read_text())
        bad = {**content["videos"][0], "id": "bad", "size": [40 * SIZE[0], 40 * SIZE[1]]}
        content["videos"].append(bad)
        file.write_text(yaml.safe_dump(content))

    def start(
        self,
        command: str,
        *words: str,
        threads: int = 1,
        name: str = NAME,
        faults: Mapping[str, str] = MappingProxyType({}),
    ) -> subprocess.Popen[bytes]:
        """`imocap COMMAND NAME WORDS`, with the parameters that make it quick.

        faults: variables of `faulty`.
        """
        program = "tools.chaos.faulty" if faults else "stages"
        line = [sys.executable, "-m", program, "--root", str(self.root), *command.split(), name]
        environment = {**os.environ, **dict.fromkeys(THREADS, str(threads)), **faults}
        return subprocess.Popen(
            [*line, *words, *sets()],
            cwd=PROJECT,
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )

    def finish(self, command: str, *words: str, **named: Any) -> None:
        """The same to its end; AssertionError when it fails."""
        process = self.start(command, *words, **named)
        _, errors = process.communicate()
        assert process.returncode == 0, errors.decode(errors="replace")[-500:]

    def with_library(self, library: Path) -> dict[str, str]:
        """Variables with which this Python runs detectors, with a library that stands in."""
        places = [str(library), str(PROJECT), os.environ.get("PYTHONPATH", "")]
        return {
            "PYTHONPATH": os.pathsep.join(filter(None, places)),
            "IMOCAP_DETECT_PYTHON": sys.executable,
        }

    def results(self) -> dict[str, str]:
        """The content digest of every stage's current artifact."""
        store = Store(self.artifacts)
        stored = {stage: store.load(NAME, stage) for stage in STAGES}
        return {stage: result.digest for stage, result in stored.items() if result is not None}

    def forget(self) -> None:
        """Remove all results."""
        shutil.rmtree(self.artifacts)

    def differences(self) -> list[str]:
        """What is not as after an undisturbed run: stages, inputs, hidden files left behind."""
        results, inputs = self.results(), digests_below(self.root / "actions" / NAME)
        wrong = [stage for stage in STAGES if results.get(stage) != self.expected[stage]]
        return wrong + ["inputs"] * (inputs != self.inputs) + self.leftovers()

    def differences_after(self, command: str, *words: str, **named: Any) -> list[str]:
        """The same after a command."""
        self.finish(command, *words, **named)
        return self.differences()

    def leftovers(self) -> list[str]:
        """Hidden files in the store that do not belong there."""
        hidden = self.artifacts.rglob(".*")
        return sorted(str(p) for p in hidden if p.name not in STAYS)


def refused(process: subprocess.Popen[bytes]) -> list[str]:
    """What is wrong with the end of a command that had to fail: nothing, if it is a sentence."""
    _, errors = process.communicate()
    text = errors.decode(errors="replace").strip()
    lines = [line for line in text.splitlines() if line.startswith("imocap: ")]
    one = process.returncode == 1 and len(lines) == 1 and "fault of the program" not in text
    return [] if one and "Traceback" not in text else [f"exit {process.returncode}: {text[-300:]}"]


def part_of(tried: int, wrong: list[str]) -> Part:
    """A part of the record."""
    return {"tried": tried, "lost": len(wrong), "what": wrong}


def digests_below(folder: Path) -> dict[str, str]:
    """The digest of every file in a folder, by its relative name."""
    files = (p for p in sorted(folder.rglob("*")) if p.is_file())
    return {p.relative_to(folder).as_posix(): _digest(p) for p in files}


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()

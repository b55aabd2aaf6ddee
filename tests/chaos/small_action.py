"""A small action on disk, and the command line on it as processes of their own."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from imocap_core.artifacts.store import Store
from imocap_core.pipeline.source import PROJECT
from tests.report.made import FPS, SIZE, Made

NAME = "serve"
QUICK = {
    "initial_smpl.library_poses": 60,
    "initial_smpl.library_directions": 12,
    "initial_smpl.starts": 1,
    "initial_smpl.max_steps": 2,
    "motion.rounds": 1,
    "motion.max_steps": 2,
    "refine.max_rounds": 1,
    "evaluate.figures": "false",
}
SETS = [word for path, value in QUICK.items() for word in ("--set", f"{path}={value}")]
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
STAYS = (".lock", ".cache", ".used", ".made.json")  # hidden files and folders that belong there


@dataclass(frozen=True)
class SmallAction:
    """A working folder with one action of two videos' keypoints."""

    root: Path

    @classmethod
    def make(cls, root: Path) -> SmallAction:
        """Write the action."""
        made = Made(count=2, frames=24)
        columns = list(made.model.points("body25").columns)
        folder = root / "actions" / NAME
        videos = []
        for video in made.keypoints.videos:
            (folder / video.id).mkdir(parents=True)
            for frame, xy in enumerate(video.xy_px):
                person = np.zeros((25, 3))
                person[columns] = np.column_stack([xy, np.full(len(xy), 0.9)])
                people = [{"pose_keypoints_2d": person.ravel().tolist()}]
                file = folder / video.id / f"c_{frame:06d}_keypoints.json"
                file.write_text(json.dumps({"people": people}))
            fields = {"format": "openpose", "layout": "body25", "fps": FPS, "size": list(SIZE)}
            videos.append({"id": video.id, "keypoints": video.id, **fields})
        (folder / "action.yaml").write_text(yaml.safe_dump({"name": NAME, "videos": videos}))
        return cls(root)

    def add_bad_video(self) -> None:
        """Declare a third video, whose size its keypoints contradict."""
        file = self.root / "actions" / NAME / "action.yaml"
        content = yaml.safe_load(file.read_text())
        bad = {**content["videos"][0], "id": "bad", "size": [40 * SIZE[0], 40 * SIZE[1]]}
        content["videos"].append(bad)
        file.write_text(yaml.safe_dump(content))

    def start(self, command: str, *words: str, threads: int = 1) -> subprocess.Popen[bytes]:
        """`imocap COMMAND serve WORDS`, with the parameters that make it quick."""
        line = [sys.executable, "-m", "stages", "--root", str(self.root), *command.split(), NAME]
        environment = {**os.environ, **dict.fromkeys(THREADS, str(threads))}
        return subprocess.Popen(
            [*line, *words, *SETS],
            cwd=PROJECT,
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )

    def finish(self, command: str, *words: str, threads: int = 1) -> None:
        """The same to its end; AssertionError when it fails."""
        process = self.start(command, *words, threads=threads)
        _, errors = process.communicate()
        assert process.returncode == 0, errors.decode(errors="replace")[-500:]

    def results(self, stages: Sequence[str]) -> dict[str, str]:
        """The content digest of every stage's current artifact."""
        store = Store(self.root / "artifacts")
        stored = {stage: store.load(NAME, stage) for stage in stages}
        return {stage: result.digest for stage, result in stored.items() if result is not None}

    def inputs(self) -> dict[str, str]:
        """The digest of every file of the action."""
        folder = self.root / "actions"
        return {str(p): _digest(p) for p in sorted(folder.rglob("*")) if p.is_file()}

    def leftovers(self) -> list[str]:
        """Hidden files in the store that do not belong there."""
        hidden = (self.root / "artifacts").rglob(".*")
        return sorted(str(p) for p in hidden if p.name not in STAYS)


def digests_below(folder: Path) -> dict[str, str]:
    """The digest of every file in a folder, by its relative name."""
    files = (p for p in sorted(folder.rglob("*")) if p.is_file())
    return {p.relative_to(folder).as_posix(): _digest(p) for p in files}


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()

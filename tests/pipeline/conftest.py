"""A working folder with a tiny pipeline of three stages, run by the real harness.

gather reads the detections, scale doubles them or not, evaluate compares with the truth. Each run
of a stage adds its name to the file `ran`, each asks the environment whether to break.
"""

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml

from imocap_core.pipeline.graph import VARIABLE
from tests.processes import in_new_process

HEAD = """
import os, signal
from pathlib import Path
import numpy as np
from imocap_core.artifacts.schemas.base import Artifact

class Numbers(Artifact):
    values: dict[str, float]
    seed: float

def came(stage):
    root = Path(os.environ["TOY_ROOT"])
    with (root / "ran").open("a") as stream:
        print(stage, file=stream)
    how = os.environ.get("TOY_" + stage.upper())
    once = root / "killed"
    if how == "kill" or (how == "kill once" and not once.exists()):
        once.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if how and how.startswith("signal"):
        os.kill(os.getpid(), int(how.split()[1]))
    if how in ("changed", "restored"):
        file = root / "actions" / "toy" / "v1.txt"
        before = file.read_text()
        file.write_text("9")
        if how == "restored":
            file.write_text(before)
    if how == "bad":
        raise ValueError("keypoints/v1: expected numbers, got [nonsense]")
    if how == "bug":
        {}["x"]
    if how == "truth":
        return True
"""
SCRIPTS = {
    "gather": """
def run(ctx, inputs, params):
    came("gather")
    ctx.progress(0.5, "halfway [v1]")
    paths = {v.id: ctx.detections(v.id) for v in ctx.declarations()}
    values = {name: float(path.read_text()) for name, path in paths.items()}
    return Numbers(values=values, seed=ctx.rng().random())
""",
    "scale": """
class Scaled(Numbers):
    pass

def run(ctx, inputs, params):
    if came("scale"):
        ctx.truth()
    factor = 2.0 if params.sync.method == "als" else 1.0
    numbers = inputs.get(Numbers)
    values = {name: factor * value for name, value in numbers.values.items()}
    return Scaled(values=values, seed=numbers.seed)
""",
    "evaluate": """
class Scaled(Numbers):
    pass

class Score(Artifact):
    error: float | None

def run(ctx, inputs, params):
    came("evaluate")
    truth = ctx.truth()
    values = inputs.get(Scaled).values
    error = None
    if truth is not None:
        error = abs(sum(values.values()) - float(np.load(truth)["sum"]))
    (ctx.report / "index.md").write_text(f"error {error}")
    return Score(error=error)
""",
}
SCALE_BY_PARTS = """
class Scaled(Numbers):
    pass

def run(ctx, inputs, params):
    came("scale")
    values = {name: part(ctx, inputs, params, name) for name in inputs.get(Numbers).values}
    return Scaled(values=values, seed=inputs.get(Numbers).seed)

def part(ctx, inputs, params, name):
    factor = 2.0 if params.sync.method == "als" else 1.0
    value = inputs.get(Numbers).values[name]

    def make():
        came(f"part_{name}")
        return Numbers(values={"any": factor * value}, seed=0.0)

    return ctx.part("value", {"value": repr(value)}, Numbers, make).values["any"]

make_part = part
"""
STAGES = {
    "gather": {"inputs": [], "reads": ["declarations", "detections"], "params": []},
    "scale": {"inputs": ["gather"], "reads": [], "params": ["sync"]},
    "evaluate": {"inputs": ["gather", "scale"], "reads": ["truth"], "params": ["evaluate"]},
}
ACTION = """\
name: toy
videos:
  - {id: v1, keypoints: v1.txt, format: npz, layout: body25, fps: 30, size: [640, 360]}
  - {id: v2, keypoints: v2.txt, format: npz, layout: body25, fps: 30, size: [640, 360]}
"""


@dataclass(frozen=True)
class Toy:
    """The working folder, and the command line in it."""

    root: Path

    @property
    def action(self) -> Path:
        """The action's folder."""
        return self.root / "actions" / "toy"

    def split(self) -> None:
        """Make the stage `scale` of parts, one a video."""
        (self.root / "toys" / "scale.py").write_text(HEAD + SCALE_BY_PARTS)
        graph = yaml.safe_load((self.root / "pipeline.yaml").read_text())
        graph["stages"]["scale"]["parts"] = "videos"
        (self.root / "pipeline.yaml").write_text(yaml.safe_dump(graph, sort_keys=False))

    def ran(self) -> list[str]:
        """The stages that ran since this was last asked."""
        log = self.root / "ran"
        names = log.read_text().split() if log.exists() else []
        log.unlink(missing_ok=True)
        return names

    def digests(self) -> dict[str, str]:
        """The content digest of every current artifact."""
        from imocap_core.artifacts.store import Store

        store = Store(self.root / "artifacts")
        found = {stage: store.load("toy", stage) for stage in STAGES}
        return {stage: stored.digest for stage, stored in found.items() if stored is not None}

    def apart(self, *words: str, **environment: str) -> tuple[int, str]:
        """Run `imocap WORDS` in a process of its own: its exit code and standard error."""
        errors = self.root / "errors"
        wanted = {**os.environ, **environment}
        return in_new_process(_run, self, words, wanted, errors), errors.read_text()

    def imocap(self, words: Sequence[str]) -> int:
        """Run `imocap WORDS` in this process; its exit code."""
        from imocap_core.cli import main

        return main([*words, "--root", str(self.root)])


def _run(toy: Toy, words: Sequence[str], environment: dict[str, str], errors: Path) -> None:
    os.environ.update(environment)
    with errors.open("w", buffering=1) as sys.stderr:
        code = toy.imocap(words)
    sys.exit(code)


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Toy:
    """A fresh working folder; TOY_<STAGE> says how a stage shall break."""
    (tmp_path / "toys").mkdir()
    for name, text in SCRIPTS.items():
        (tmp_path / "toys" / f"{name}.py").write_text(HEAD + text)
    stages = {name: {"script": f"toys/{name}.py", **spec} for name, spec in STAGES.items()}
    content = {"seed": 7, "stages": stages, "params": {"sync": {"method": "softmap"}}}
    (tmp_path / "pipeline.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    made = Toy(tmp_path)
    made.action.mkdir(parents=True)
    (made.action / "action.yaml").write_text(ACTION)
    (made.action / "v1.txt").write_text("1.5")
    (made.action / "v2.txt").write_text("2.5")
    monkeypatch.setenv("TOY_ROOT", str(tmp_path))
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    return made

"""Run the stages of an action: what is cached is reused, what has changed is made again."""

from __future__ import annotations

import importlib
import importlib.util
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, cast, runtime_checkable

from imocap_core.artifacts.file_memory import save_memory
from imocap_core.artifacts.store import Store, Stored
from imocap_core.errors import ArtifactCorrupt, WorkFailed, program_fault
from imocap_core.pipeline.action import Action
from imocap_core.pipeline.graph import Pipeline, RunSettings
from imocap_core.pipeline.keys import Recipe, differences, recipe
from imocap_core.pipeline.source import module_name
from imocap_core.pipeline.stage import Context, Inputs, Progress
from imocap_core.process import configure_process

if TYPE_CHECKING:
    from imocap_core.artifacts.schemas.base import Artifact

Run = Callable[[Context, Inputs, Any], "Artifact"]


@runtime_checkable
class Display(Protocol):
    """Who shows a run to its user."""

    def started(self, stage: str, why: list[str]) -> None:
        """A stage begins, for these reasons."""

    def progress(self, share: float, what: str) -> None:
        """The stage at work is this far."""

    def finished(self, outcome: Outcome) -> None:
        """A stage has its artifact."""

    def made_demo(self, name: str, folder: Path) -> None:
        """A built-in action has been made."""

    def waiting(self) -> None:
        """Another run of the same action is at work."""


@dataclass(frozen=True)
class Outcome:
    """How a stage came to its artifact."""

    stage: str
    how: Literal["cached", "made"]
    stored: Stored
    seconds: float


@dataclass(frozen=True)
class StageStatus:
    """What would happen to a stage if the action ran now."""

    stage: str
    state: Literal["cached", "would run"]
    why: list[str]
    stored: Stored | None = None


@dataclass(frozen=True)
class Job:
    """An action, the graph it goes through, its settings, and where results are kept."""

    pipeline: Pipeline
    store: Store
    action: Action
    settings: RunSettings

    def recipe(self, stage: str, done: Mapping[str, Stored]) -> Recipe:
        """What a stage's result would be made from now; `done` holds at least its inputs."""
        inputs = {name: done[name].digest for name in self.pipeline.stages[stage].inputs}
        return recipe(self.pipeline, stage, self.action, self.settings, inputs)


def run(
    job: Job, display: Display, stages: list[str], force: frozenset[str] = frozenset()
) -> list[Outcome]:
    """Bring `stages` (in running order, closed under inputs) up to date; `force` ones run anyway.

    WorkFailed when a stage can't do its work; the artifacts made before it stay.
    """
    outcomes: list[Outcome] = []
    done: dict[str, Stored] = {}
    with job.store.lock(job.action.name, display.waiting):
        for stage in stages:
            began = time.perf_counter()
            wanted = job.recipe(stage, done)
            forced = stage in force
            stored = None if forced else job.store.find(job.action.name, stage, wanted.key)
            how: Literal["cached", "made"] = "cached" if stored else "made"
            if stored is None:
                why = ["forced"] if forced else _reasons(job, stage, wanted)
                display.started(stage, why)
                stored = _make(job, stage, wanted, done, display.progress)
            job.store.publish(job.action.name, stage, stored)
            done[stage] = stored
            outcomes.append(Outcome(stage, how, stored, time.perf_counter() - began))
            display.finished(outcomes[-1])
    save_memory(job.store.folder)
    return outcomes


def stage_statuses(job: Job) -> Iterator[StageStatus]:
    """For each stage, whether it is cached, and if not, why it would run."""
    done: dict[str, Stored] = {}
    for stage, spec in job.pipeline.stages.items():
        missing = [name for name in spec.inputs if name not in done]
        if missing:
            yield StageStatus(stage, "would run", [f"after {', '.join(missing)}"])
            continue
        wanted = job.recipe(stage, done)
        stored = job.store.look_up(job.action.name, stage, wanted.key)
        if stored is None:
            yield StageStatus(stage, "would run", _reasons(job, stage, wanted))
        else:
            done[stage] = stored
            yield StageStatus(stage, "cached", [], stored)
    save_memory(job.store.folder)


def _reasons(job: Job, stage: str, wanted: Recipe) -> list[str]:
    try:
        current = job.store.load(job.action.name, stage)
    except ArtifactCorrupt as error:
        return [f"the artifact is damaged: {error}"]
    if current is None:
        return ["never run"]
    return differences(current.content.provenance, wanted) or ["its cached result is damaged"]


def _make(
    job: Job, stage: str, wanted: Recipe, done: Mapping[str, Stored], progress: Progress
) -> Stored:
    configure_process()
    spec = job.pipeline.stages[stage]
    inputs = Inputs(stage, {name: done[name] for name in spec.inputs})
    params = Visible(stage, {name: getattr(job.settings.params, name) for name in spec.params})
    with tempfile.TemporaryDirectory(prefix="imocap-") as folder:
        report = Path(folder)
        context = Context(
            stage, job.settings.seed, frozenset(spec.reads), progress, report, job.action
        )
        artifact = _call(job.pipeline.script(stage), context, inputs, params)
        paths = sorted(p for p in report.rglob("*") if p.is_file())
        files = {path.relative_to(report).as_posix(): path.read_bytes() for path in paths}
    return job.store.put(stage, wanted.key, artifact, wanted.provenance(), files)


def _call(script: Path, context: Context, inputs: Inputs, params: Visible) -> Artifact:
    """Run a stage's script; whatever goes wrong in it becomes one sentence."""
    from imocap_core.artifacts.schemas.base import Artifact

    try:
        artifact = _load(script)(context, inputs, params)
        assert isinstance(artifact, Artifact), f"returned a {type(artifact).__name__}"
    except (ValueError, OSError, ArtifactCorrupt) as error:
        raise WorkFailed(f"{context.stage}: {error}") from error
    except KeyboardInterrupt:
        raise WorkFailed("stopped; what was finished is kept, run again to continue") from None
    except Exception as error:
        raise WorkFailed(f"{context.stage} broke: {program_fault(error)}") from error
    return artifact


def _load(script: Path) -> Run:
    """The `run` of a stage's script. Imported only now: a cached stage costs no heavy import."""
    module = module_name(script)
    if module:
        loaded = importlib.import_module(module)
    else:
        spec = importlib.util.spec_from_file_location(f"imocap_stage_{script.stem}", script)
        assert spec is not None
        assert spec.loader is not None
        loaded = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(loaded)
    return cast(Run, loaded.run)


class Visible:
    """The groups of parameters a stage declares; asking for another one is a fault."""

    def __init__(self, stage: str, groups: Mapping[str, Any]) -> None:
        self._stage, self._groups = stage, groups

    def __getattr__(self, group: str) -> Any:
        if group.startswith("_") or group not in self._groups:
            raise AttributeError(
                f"stage {self._stage} wants params.{group}, which pipeline.yaml does not list "
                f"for it"
            )
        return self._groups[group]

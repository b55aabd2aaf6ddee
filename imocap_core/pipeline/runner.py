"""Run the stages of an action: cached results are reused, what has changed is made again."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol, runtime_checkable

from imocap_core.artifacts.file_memory import save_memory
from imocap_core.artifacts.store import Store, Stored, sweep
from imocap_core.errors import ArtifactCorrupt, WorkFailed
from imocap_core.pipeline.action import Action
from imocap_core.pipeline.graph import Pipeline, RunSettings, must_be_allowed
from imocap_core.pipeline.keys import differences, read_files, recipe
from imocap_core.pipeline.source import unchanged
from imocap_core.pipeline.stage import (
    Context,
    DeclaredParams,
    Inputs,
    Parts,
    Progress,
    Recipe,
    in_a_sentence,
    load_script,
    returned_artifact,
)
from imocap_core.process import (
    CPU,
    configure_process,
    peak_bytes,
    release_freed_memory,
    restart_peak,
)


@runtime_checkable
class Display(Protocol):
    """Shows a run to its user."""

    def started(self, stage: str, why: list[str]) -> None:
        """A stage begins, for these reasons."""

    def progress(self, share: float, what: str) -> None:
        """The running stage has done this share of its work."""

    def finished(self, outcome: Outcome) -> None:
        """A stage has its artifact."""

    def made_demo(self, name: str, folder: Path) -> None:
        """A built-in action has been generated."""

    def waiting(self) -> None:
        """Another run of the same action is in progress."""

    def notice(self, sentence: str) -> None:
        """What to know while the run goes on."""


@dataclass(frozen=True)
class Outcome:
    """A stage's result in a run, and whether it was cached or made.

    peak_bytes: the largest memory of the process while it was made; None where cached or unknown.
    """

    stage: str
    how: Literal["cached", "made"]
    stored: Stored
    seconds: float
    peak_bytes: int | None = None


@dataclass(frozen=True)
class StageStatus:
    """Whether a stage's result is cached, and why it would run if not."""

    stage: str
    state: Literal["cached", "would run"]
    why: list[str]
    stored: Stored | None = None


@dataclass(frozen=True)
class Job:
    """An action, the graph of stages, the settings, and where results are stored.

    device: where stages compute their tensors, as of `check_device`; no result's key has it.
    """

    pipeline: Pipeline
    store: Store
    action: Action
    settings: RunSettings
    device: str = CPU

    def recipe(self, stage: str, done: Mapping[str, Stored]) -> Recipe:
        """What a stage's result would be made from now. done: at least its inputs' results."""
        inputs = {name: done[name].digest for name in self.pipeline.stages[stage].inputs}
        return recipe(self.pipeline, stage, self.action, self.settings, inputs)


def run(
    job: Job,
    display: Display,
    stages: list[str],
    force: frozenset[str] = frozenset(),
    ending: Callable[[list[Outcome]], object] = lambda outcomes: None,
) -> list[Outcome]:
    """Bring stages up to date, in the order given; those of `force` run even when cached.

    Args:
        stages: every one after its inputs.
        ending: what else belongs to the run (its report), done before another run may begin.

    WorkFailed when a stage fails; results of the stages before it stay.
    """
    outcomes: list[Outcome] = []
    done: dict[str, Stored] = {}
    with job.store.lock(job.action.name, display.waiting):
        sweep(job.store.folder, job.action.name)
        cached = {} if force else _all_cached(job, stages)
        for stage in stages:
            began = time.perf_counter()
            release_freed_memory()
            restart_peak()
            how: Literal["cached", "made"] = "cached"
            stored = cached.get(stage)
            if stored is None:
                needed, forced = job.recipe(stage, done), stage in force
                if not forced:
                    stored = job.store.find(job.action.name, stage, needed.key)
            if stored is None:
                how = "made"
                display.started(stage, ["forced"] if forced else _reasons(job, stage, needed))
                stored = _make(job, stage, needed, done, display.progress, forced)
            job.store.publish(job.action.name, stage, stored)
            stored = done[stage] = stored.unread()
            most = peak_bytes() if how == "made" else None
            outcomes.append(Outcome(stage, how, stored, time.perf_counter() - began, most))
            display.finished(outcomes[-1])
        ending(outcomes)
    save_memory(job.store.folder)
    return outcomes


def _all_cached(job: Job, stages: list[str]) -> dict[str, Stored]:
    """The results of these stages, not read again where their files have not changed; none of them
    where one is missing, as those before it will be read."""
    done: dict[str, Stored] = {}
    for stage in stages:
        stored = job.store.look_up(job.action.name, stage, job.recipe(stage, done).key)
        if stored is None:
            return {}
        done[stage] = stored
    return done


def stage_statuses(job: Job) -> Iterator[StageStatus]:
    """For each stage, whether it is cached, and if not, why it would run."""
    done: dict[str, Stored] = {}
    for stage, spec in job.pipeline.stages.items():
        missing = [name for name in spec.inputs if name not in done]
        if missing:
            yield StageStatus(stage, "would run", [f"after {', '.join(missing)}"])
            continue
        needed = job.recipe(stage, done)
        stored = job.store.look_up(job.action.name, stage, needed.key)
        if stored is None:
            yield StageStatus(stage, "would run", _reasons(job, stage, needed))
        else:
            done[stage] = stored
            yield StageStatus(stage, "cached", [], stored)
    save_memory(job.store.folder)


def make_part(job: Job, stage: str, video: str, display: Display) -> None:
    """Make the part of a stage's result that a video determines, unless the result, or the part,
    is cached.

    Stages before it are brought up to date. Several parts of one action may be made at once.

    WorkFailed when it can't be made.
    """
    before = job.pipeline.upstream(stage)[:-1]
    done = {outcome.stage: outcome.stored for outcome in run(job, display, before)}
    needed = job.recipe(stage, done)
    if job.store.look_up(job.action.name, stage, needed.key) is not None:
        return
    must_be_allowed(job.pipeline, stage)
    configure_process()
    display.started(stage, [])
    with tempfile.TemporaryDirectory() as folder:
        prepared = _prepared(job, stage, needed, done, display.progress, Path(folder), again=False)
        with unchanged(read_files(job.pipeline, stage, job.action)):
            make = load_script(job.pipeline.script(stage)).make_part
            in_a_sentence(stage, lambda: make(*prepared, video))


def _prepared(
    job: Job,
    stage: str,
    needed: Recipe,
    done: Mapping[str, Stored],
    progress: Progress,
    report: Path,
    *,
    again: bool,
) -> tuple[Context, Inputs, DeclaredParams]:
    """What a stage's functions are called with; again: parts that are kept are made once more."""
    spec = job.pipeline.stages[stage]
    reads, seed = frozenset(spec.reads), job.settings.seed
    parts = Parts(job.store, job.action.name, stage, needed, again)
    context = Context(stage, seed, reads, progress, report, job.action, parts, job.device)
    inputs = Inputs(stage, {name: done[name] for name in spec.inputs})
    groups = {name: getattr(job.settings.params, name) for name in spec.params}
    return context, inputs, DeclaredParams(stage, groups)


def _reasons(job: Job, stage: str, needed: Recipe) -> list[str]:
    try:
        current = job.store.load(job.action.name, stage)
    except ArtifactCorrupt as error:
        return [f"the artifact is damaged: {error}"]
    if current is None:
        return ["never run"]
    return differences(current.content.provenance, needed) or ["its cached result is damaged"]


def _make(
    job: Job,
    stage: str,
    needed: Recipe,
    done: Mapping[str, Stored],
    progress: Progress,
    forced: bool,
) -> Stored:
    must_be_allowed(job.pipeline, stage)
    configure_process()
    place = job.store.folder / job.action.name  # leftovers of a killed run are swept there
    with tempfile.TemporaryDirectory(prefix=".stage-", dir=place) as folder:
        report = Path(folder)
        prepared = _prepared(job, stage, needed, done, progress, report, again=forced)
        with unchanged(read_files(job.pipeline, stage, job.action)):
            stage_run = load_script(job.pipeline.script(stage)).run
            artifact = in_a_sentence(stage, lambda: returned_artifact(stage_run(*prepared)))
        if job.recipe(stage, done).reads != needed.reads:
            raise WorkFailed(f"{stage}: what it reads was changed as it began; run again")
        paths = sorted(p for p in report.rglob("*") if p.is_file())
        files = {path.relative_to(report).as_posix(): path.read_bytes() for path in paths}
    return job.store.put(stage, needed.key, artifact, needed.provenance(), files)

"""The results of one run: what belongs together in the store.

Every result carries the recipe that it was made by. Together results are one generation when each
was made from the others that are read, and a current one when their recipes are those of now:
the same files, declarations, parameters and seed. Code may have changed since; that alone makes a
result old, not wrong.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from imocap_core.artifacts.store import Stored
from imocap_core.errors import ArtifactCorrupt, WorkFailed
from imocap_core.pipeline.graph import SCORING_STAGE
from imocap_core.pipeline.keys import recipe, value_differences
from imocap_core.pipeline.runner import Job

MAX_REASONS = 3


@dataclass(frozen=True)
class Stale:
    """A result that is not what the action gives now, and in what it differs."""

    stage: str
    why: list[str]
    provenance: Mapping[str, str]


def generation(job: Job, sets: list[str], *, scored: bool = False) -> dict[str, Stored]:
    """The current results of a job by stage; stages that never ran are absent.

    Args:
        sets: the parameters given for this once. With some, results from the cache are taken too;
            without, the current ones and no others.
        scored: those of the scoring stage too.

    WorkFailed, with the command that mends it, when some are of another run or of other inputs.
    """
    done: dict[str, Stored] = {}
    stale: list[Stale] = []
    for stage in job.pipeline.stages:
        if stage == SCORING_STAGE and not scored:
            continue
        current = _current(job, stage)
        if current is None and not sets:
            continue
        provenance = {} if current is None else current.content.provenance
        spec, settings = job.pipeline.stages[stage], job.settings
        inputs = {name: done[name].digest for name in spec.inputs if name in done}
        reads = json.loads(provenance.get("reads", "{}"))  # a file that is gone is unchanged
        needed = recipe(job.pipeline, stage, job.action, settings, inputs, reads)
        if current is None:
            why = ["never run"]
        elif "inputs" not in provenance:
            why = ["it does not say what it was made from"]
        else:
            why = value_differences(provenance, needed)
        if why and sets and (cached := job.store.find(job.action.name, stage, needed.key)):
            current, why = cached, []
        if current is not None:
            done[stage] = current
        if why:
            stale.append(Stale(stage, why, provenance))
    if stale:
        raise WorkFailed(_refusal(job, stale, sets))
    return done


def run_command(job: Job, sets: list[str]) -> str:
    """The command that brings a job's results up to date."""
    folder = job.action.folder
    usual = job.store.folder.resolve().parent / "actions" / job.action.name
    name = job.action.name if folder == usual else str(folder)
    return " ".join(["imocap run", name, *(f"--set {text}" for text in sets)])


def _current(job: Job, stage: str) -> Stored | None:
    """A stage's current artifact; a damaged one is said by whoever decodes it."""
    try:
        return job.store.load(job.action.name, stage)
    except ArtifactCorrupt as error:
        reason = str(error).splitlines()[0]
        raise WorkFailed(
            f"{stage} of {job.action.name}: {reason}; run it with: {run_command(job, [])}"
        ) from None


def _refusal(job: Job, stale: list[Stale], sets: list[str]) -> str:
    first = stale[0]
    more = len(first.why) - MAX_REASONS
    why = "; ".join(first.why[:MAX_REASONS]) + (f"; and {more} more" if more > 0 else "")
    text = (
        f"{job.action.name}: its results are not those of its files and parameters now "
        f"({first.stage}: {why}). Bring them up to date: {run_command(job, sets)}"
    )
    variant = _variant(job, stale)
    if variant and not sets:
        text += f"; or name the parameters that they were made with: {variant}"
    return text


def _variant(job: Job, stale: list[Stale]) -> str:
    """The `--set` of a variant, where parameters, and results that they changed, are all that
    differs."""
    variant: dict[str, Any] = {}
    for one in stale:
        before = json.loads(one.provenance.get("params", "{}"))
        now = job.settings.of(job.pipeline.stages[one.stage].params)
        changed = {
            f"{group}.{name}": before[group][name]
            for group, values in now.items()
            for name, value in values.items()
            if before.get(group, {}).get(name, value) != value
        }
        seed = json.loads(one.provenance.get("seed", "null"))
        if seed != job.settings.seed and seed is not None:
            changed["seed"] = seed
        if len(changed) < len(one.why):
            return ""
        variant |= changed
    return " ".join(f"--set {name}={json.dumps(value)}" for name, value in variant.items())


LAST_RUN = "run.json"  # the record of the action's last run (`library.running`)

"""pipeline.yaml: the graph of the stages, the values that differ from the defaults, its scripts.

The defaults, types and bounds of all parameters are those of `imocap_core.params`.

Stages whose scripts lie in a working folder are run only where their user has allowed it. A
pipeline.yaml names scripts, and a working folder may come from somebody else. Scripts of this
program always run; those of a folder when IMOCAP_ALLOW_SCRIPTS lists that folder (`--allow-scripts`
adds the working folder for one command).
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator

from imocap_core.errors import WorkFailed, WrongUse, did_you_mean
from imocap_core.params import Params
from imocap_core.pipeline.action import explain_faults, parse
from imocap_core.pipeline.source import PROJECT, module_name
from imocap_core.pipeline.stage import Read
from imocap_core.pipeline.yaml_file import load_yaml

FILE_NAME = "pipeline.yaml"
SCORING_STAGE = "evaluate"  # the only one that may read the truth
SEED = "seed"
GROUPS = [f.name for f in fields(Params)]


class StageSpec(BaseModel):
    """One stage of the graph.

    parts: "videos" where the result has a part for each video that can be made by itself; the
    script has `make_part` then.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    script: str
    inputs: list[str]
    reads: list[Read]
    params: list[str]
    parts: Literal["videos"] | None = None


class _PipelineFile(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    seed: Annotated[int, Field(ge=0)]
    stages: dict[str, StageSpec]
    params: dict[str, Any] | None = None

    @model_validator(mode="after")
    def _graph_is_sound(self) -> _PipelineFile:
        faults = []
        before: list[str] = []
        for name, stage in self.stages.items():
            faults += [
                f"{name}.inputs: expected earlier stages{_listed(before)}, got {given!r}"
                for given in stage.inputs
                if given not in before
            ]
            faults += [
                f"{name}.params: expected groups of parameters{_listed(GROUPS)}, got {group!r}: "
                "correct or remove it"
                for group in stage.params
                if group not in GROUPS
            ]
            if "truth" in stage.reads and name != SCORING_STAGE:
                faults.append(f"{name}.reads: only {SCORING_STAGE} may read truth")
            before.append(name)
        if faults:
            raise ValueError("; ".join(faults))
        return self


@dataclass(frozen=True)
class Pipeline:
    """The graph, and the parameters where neither an action nor `--set` changes them."""

    file: Path
    seed: int
    stages: Mapping[str, StageSpec]  # in the order they run
    params: Params

    def script(self, stage: str) -> Path:
        """A stage's script: beside pipeline.yaml, or where this package is installed."""
        relative = self.stages[stage].script
        places = [base / relative for base in (self.file.parent, PROJECT, PROJECT / "imocap_core")]
        for place in places:
            if place.is_file():
                return place.resolve()
        raise WorkFailed(f"{self.file}: stages.{stage}.script: {places[0]} does not exist")

    def upstream(self, stage: str) -> list[str]:
        """A stage's inputs, their inputs, and so on, and the stage itself, in running order."""
        wanted = {stage}
        for name in reversed(list(self.stages)):
            if name in wanted:
                wanted |= set(self.stages[name].inputs)
        return [name for name in self.stages if name in wanted]


@dataclass(frozen=True)
class RunSettings:
    """The seed and the parameters of one run, after all overrides."""

    seed: int
    params: Params

    def of(self, groups: Sequence[str]) -> dict[str, dict[str, Any]]:
        """The values of some groups, as plain data."""
        return {group: asdict(getattr(self.params, group)) for group in groups}


def read_pipeline(file: Path) -> Pipeline:
    """Read and check pipeline.yaml. WorkFailed names every fault in it at once."""
    parsed = parse(_PipelineFile, load_yaml(file), str(file))
    source = f"{file}: params"
    params = _changed(Params(), parsed.params or {}, source)
    return Pipeline(file, parsed.seed, parsed.stages, params)


def settings(
    pipeline: Pipeline, action_params: Mapping[str, Any], action_file: Path, sets: list[str]
) -> RunSettings:
    """The pipeline's values, then the action's `params`, then one-off `--set group.name=value`.

    WorkFailed when action.yaml is at fault, WrongUse when a `--set` is.
    """
    source = f"{action_file}: params"
    params = _changed(pipeline.params, action_params, source)
    seed = _seed(action_params.get(SEED, pipeline.seed), f"{source}.{SEED}")
    once = _parse_sets(sets)
    try:
        params = _changed(params, once, "--set")
        return RunSettings(_seed(once.get(SEED, seed), f"--set {SEED}"), params)
    except WorkFailed as error:
        raise WrongUse(str(error)) from None


@cache
def _adapter() -> TypeAdapter[Params]:
    return TypeAdapter(Params)


def _changed(params: Params, changes: Mapping[str, Any], source: str) -> Params:
    """Parameters with changes, types and bounds checked; WorkFailed names every fault."""
    if not changes:
        return params
    try:
        return _adapter().validate_python(_merge(asdict(params), changes, source))
    except ValidationError as error:
        raise WorkFailed(explain_faults(error, source)) from None


def _merge(
    values: Mapping[str, Mapping[str, Any]], changes: Mapping[str, Any], source: str
) -> dict[str, dict[str, Any]]:
    """Values by group and name with changes; WorkFailed for an unknown group or name."""
    merged = {group: dict(by_name) for group, by_name in values.items()}
    for group, by_name in changes.items():
        if group == SEED:
            continue
        if group not in merged:
            raise WorkFailed(
                f"{source}: {group}: unknown group of parameters; expected one of "
                f"{', '.join(merged)}.{did_you_mean(group, merged)}"
            )
        if not isinstance(by_name, Mapping):
            raise WorkFailed(f"{source}: {group}: expected 'name: value' pairs, got {by_name!r}")
        unknown = [name for name in by_name if name not in merged[group]]
        if unknown:
            raise WorkFailed(
                f"{source}: {group}.{unknown[0]}: unknown parameter; expected one of "
                f"{', '.join(merged[group])}.{did_you_mean(unknown[0], merged[group])}"
            )
        merged[group].update(by_name)
    return merged


def _seed(value: Any, field: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise WorkFailed(f"{field}: expected a whole number from 0 up, got {value!r}")
    return value


def _parse_sets(sets: list[str]) -> dict[str, Any]:
    import yaml

    parsed: dict[str, Any] = {}
    for text in sets:
        path, equals, value = text.partition("=")
        group, dot, name = path.strip().partition(".")
        if not equals or not (dot or group == SEED):
            raise WrongUse(f"--set {text}: expected group.name=value, as in sync.method=als")
        try:
            read = yaml.safe_load(value)
        except (yaml.YAMLError, ValueError, RecursionError):
            raise WrongUse(f"--set {path}: expected a YAML value, got {value[:200]!r}") from None
        if group == SEED:
            parsed[SEED] = read
        else:
            parsed.setdefault(group, {})[name] = read
    return parsed


def _listed(names: Sequence[str]) -> str:
    return f" ({', '.join(names)})" if names else ""


VARIABLE = "IMOCAP_ALLOW_SCRIPTS"


def foreign_scripts(pipeline: Pipeline) -> list[Path]:
    """Scripts of a pipeline that are no part of this program and that nobody has allowed."""
    allowed = os.environ.get(VARIABLE, "").split(os.pathsep)
    if pipeline.file.parent.resolve() in {Path(place).resolve() for place in allowed if place}:
        return []
    scripts = (pipeline.script(stage) for stage in pipeline.stages)
    return [script for script in scripts if not module_name(script)]


def allow_scripts(folder: Path) -> None:
    """Allow the scripts of a working folder, in this process and those that it starts."""
    given = os.environ.get(VARIABLE)
    places = [given] if given else []
    os.environ[VARIABLE] = os.pathsep.join([*places, str(folder.resolve())])


def must_be_allowed(pipeline: Pipeline, stage: str) -> None:
    """WorkFailed when a stage's script is foreign; nothing of it has been run then."""
    script = pipeline.script(stage)
    if script in foreign_scripts(pipeline):
        raise WorkFailed(
            f"{pipeline.file}: stages.{stage}.script: {script} is no part of imocap, and would run "
            f"with your rights. Read it; if you trust it, add --allow-scripts, or set "
            f"{VARIABLE}={pipeline.file.parent.resolve()}"
        )

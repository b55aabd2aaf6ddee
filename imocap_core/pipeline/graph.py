"""pipeline.yaml: the graph of the stages and every default value, validated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Generic, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.pipeline.action import explain_faults, load_yaml, parse
from imocap_core.pipeline.source import PROJECT
from imocap_core.pipeline.stage import Read

FILE_NAME = "pipeline.yaml"
SCORING_STAGE = "evaluate"  # the only one that may read the truth
SEED = "seed"

Groups = TypeVar("Groups", bound=BaseModel)


class StageSpec(BaseModel):
    """One stage of the graph."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    script: str
    inputs: list[str]
    reads: list[Read]
    params: list[str]


class _PipelineFile(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    seed: Annotated[int, Field(ge=0)]
    stages: dict[str, StageSpec]
    params: dict[str, dict[str, Any]]

    @model_validator(mode="after")
    def _graph_is_sound(self) -> _PipelineFile:
        faults = []
        before: list[str] = []
        for name, stage in self.stages.items():
            faults += [
                f"{name}.inputs: {given!r} is no stage before it" + _there_are(before)
                for given in stage.inputs
                if given not in before
            ]
            faults += [
                f"{name}.params: {group!r} is no group of params" + _there_are(list(self.params))
                for group in stage.params
                if group not in self.params
            ]
            if "truth" in stage.reads and name != SCORING_STAGE:
                faults.append(f"{name}.reads: truth is for {SCORING_STAGE} alone")
            before.append(name)
        if faults:
            raise ValueError("; ".join(faults))
        return self


@dataclass(frozen=True)
class Pipeline(Generic[Groups]):
    """The graph, and the model that its parameters obey."""

    file: Path
    seed: int
    stages: Mapping[str, StageSpec]  # in the order they run
    defaults: Mapping[str, Mapping[str, Any]]
    model: type[Groups]

    def script(self, stage: str) -> Path:
        """A stage's script: beside pipeline.yaml, or where this package is installed."""
        relative = self.stages[stage].script
        places = [base / relative for base in (self.file.parent, PROJECT, PROJECT / "imocap_core")]
        for place in places:
            if place.is_file():
                return place.resolve()
        raise WorkFailed(f"{self.file}: stages.{stage}.script: there is no {places[0]}")

    def upstream(self, stage: str) -> list[str]:
        """A stage's inputs, their inputs, and so on, and the stage itself, in running order."""
        wanted = {stage}
        for name in reversed(list(self.stages)):
            if name in wanted:
                wanted |= set(self.stages[name].inputs)
        return [name for name in self.stages if name in wanted]


@dataclass(frozen=True)
class Settings(Generic[Groups]):
    """The seed and the parameters of one run, after all overrides."""

    seed: int
    params: Groups

    def of(self, groups: Sequence[str]) -> dict[str, dict[str, Any]]:
        """The values of some groups, as plain data."""
        return {group: getattr(self.params, group).model_dump(mode="json") for group in groups}


def read_pipeline(file: Path, model: type[Groups]) -> Pipeline[Groups]:
    """Read and check pipeline.yaml. WorkFailed names every fault in it at once."""
    parsed = parse(_PipelineFile, load_yaml(file), str(file))
    pipeline = Pipeline(file, parsed.seed, parsed.stages, parsed.params, model)
    parse(model, dict(parsed.params), f"{file}: params")
    return pipeline


def settings(
    pipeline: Pipeline[Groups], action_params: Mapping[str, Any], action_file: Path, sets: list[str]
) -> Settings[Groups]:
    """Defaults, then the action's `params`, then one-off `--set group.name=value`.

    WorkFailed when action.yaml is at fault, WrongUse when a `--set` is.
    """
    merged = _merge(pipeline.defaults, action_params, str(action_file))
    seed = _seed(action_params.get(SEED, pipeline.seed), f"{action_file}: params.{SEED}")
    params = parse(pipeline.model, merged, f"{action_file}: params")
    if not sets:
        return Settings(seed, params)
    once = _parse_sets(sets)
    try:
        merged = _merge(merged, once, "--set")
        seed = _seed(once.get(SEED, seed), f"--set {SEED}")
        return Settings(seed, pipeline.model.model_validate(merged))
    except ValidationError as error:
        raise WrongUse(explain_faults(error, "--set")) from None
    except WorkFailed as error:
        raise WrongUse(str(error)) from None


def _merge(
    under: Mapping[str, Mapping[str, Any]], over: Mapping[str, Any], file: str
) -> dict[str, dict[str, Any]]:
    merged = {group: dict(values) for group, values in under.items()}
    for group, values in over.items():
        if group == SEED:
            continue
        if group not in merged:
            raise WorkFailed(f"{file}: {group!r} is no group of params" + _there_are(list(merged)))
        if not isinstance(values, Mapping):
            raise WorkFailed(f"{file}: {group}: expected 'name: value' pairs, got {values!r}")
        unknown = [name for name in values if name not in merged[group]]
        if unknown:
            raise WorkFailed(
                f"{file}: {group}.{unknown[0]} is no parameter" + _there_are(list(merged[group]))
            )
        merged[group].update(values)
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
        except yaml.YAMLError:
            raise WrongUse(f"--set {text}: {value!r} is no value") from None
        if group == SEED:
            parsed[SEED] = read
        else:
            parsed.setdefault(group, {})[name] = read
    return parsed


def _there_are(names: Sequence[str]) -> str:
    return f" (there are: {', '.join(names)})" if names else ""

"""Calling a stage's functions: its script, its declared parameters, its errors as sentences."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeVar

from imocap_core.errors import (
    ArtifactCorrupt,
    WorkFailed,
    is_out_of_memory,
    program_fault,
    system_fault,
)
from imocap_core.pipeline.source import module_name

if TYPE_CHECKING:
    from imocap_core.artifacts.schemas.base import Artifact

Made = TypeVar("Made")


def returned_artifact(result: object) -> Artifact:
    """What a stage's `run` returned. AssertionError where that is no artifact."""
    from imocap_core.artifacts.schemas.base import Artifact

    assert isinstance(result, Artifact), f"returned a {type(result).__name__}"
    return result


def in_a_sentence(stage: str, call: Callable[[], Made]) -> Made:
    """Call a stage's function; every error in it becomes WorkFailed with one sentence."""
    try:
        return call()
    except (ValueError, ArtifactCorrupt, WorkFailed) as error:
        raise WorkFailed(f"{stage}: {error}") from error
    except OSError as error:
        raise WorkFailed(f"{stage}: {system_fault(error)}") from error
    except Exception as error:
        if is_out_of_memory(error):
            fault = system_fault(MemoryError())
            raise WorkFailed(f"{stage}: {fault}") from MemoryError(str(error))
        raise WorkFailed(f"{stage} broke: {program_fault(error)}") from error


def load_script(script: Path) -> ModuleType:
    """A stage's script, imported only when the stage runs."""
    module = module_name(script)
    if module:
        return importlib.import_module(module)
    spec = importlib.util.spec_from_file_location(f"imocap_stage_{script.stem}", script)
    assert spec is not None
    assert spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


class DeclaredParams:
    """The groups of parameters that a stage declares; AttributeError for any other."""

    def __init__(self, stage: str, groups: Mapping[str, Any]) -> None:
        self._stage, self._groups = stage, groups

    def __getattr__(self, group: str) -> Any:
        if group.startswith("_") or group not in self._groups:
            raise AttributeError(
                f"stage {self._stage} wants params.{group}, which pipeline.yaml does not list "
                f"for it"
            )
        return self._groups[group]

"""Every set of real clips at the user's defaults: facts that are right, leave-one-out errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from benchmarks.actions.captured import data_base
from benchmarks.field.facts import CheckedFact, check_facts
from benchmarks.left_out import SetErrors, run_to_prediction, set_errors
from benchmarks.parallel import ActionDisplay
from imocap_core.artifacts.schemas import CameraMotion, InitialSmpl, RefineSync
from imocap_core.artifacts.store import Stored
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.pipeline.runner import Display
from imocap_core.report.tables import ground_tables
from imocap_core.result.artifacts import artifacts_of_stages
from imocap_core.result.read import read_result
from imocap_core.result.result import ActionResult
from imocap_core.workspace import Workspace


@dataclass(frozen=True)
class FieldSet:
    """One set: its facts, and the errors of its videos."""

    name: str
    facts: list[CheckedFact]
    errors: SetErrors


def field_truth(root: Path) -> tuple[Path, dict[str, Any]]:
    """The folder of the sets, and what is true of each. WorkFailed when it is not there."""
    folder = data_base(root) / "field"
    file = folder / "truth.yaml"
    if not file.is_file():
        raise WorkFailed(f"{file}: there is no such file; IMOCAP_DATA names the folder of field/")
    truth = yaml.safe_load(file.read_text(encoding="utf-8"))
    return folder, {name: facts for name, facts in truth.items() if (folder / name).is_dir()}


def chosen_sets(truth: Mapping[str, Any], only: tuple[str, ...]) -> list[str]:
    """The sets to run; WrongUse when one does not exist."""
    for name in only:
        if name not in truth:
            raise WrongUse(f"--only {name}: expected one of {', '.join(truth)}")
    return [name for name in truth if not only or name in only]


def measure_set(display: Display, root: Path, name: str) -> FieldSet:
    """One set at the defaults."""
    folder, truth = field_truth(root)
    shown = ActionDisplay(display, name)
    workspace = Workspace(root / "artifacts" / "benchmark" / "field")
    job = workspace.ready_job(str(folder / name), [], shown)
    done = run_to_prediction(job, shown)
    return FieldSet(name, facts_of(truth[name], name, done), set_errors(done))


def facts_of(truth: Mapping[str, Any], name: str, done: Mapping[str, Stored]) -> list[CheckedFact]:
    """The facts of a run's artifacts."""
    result = read_result(artifacts_of_stages(name, done), ActionResult)
    refined = done["refine_sync"].decode(RefineSync)
    tables = ground_tables(
        done["initial_smpl"].decode(InitialSmpl),
        done["camera_motion"].decode(CameraMotion),
        refined,
    )
    ground = {
        str(row[0]): {
            c: float(x) for c, x in zip(t.columns[1:5], row[1:5], strict=True) if x is not None
        }
        for t in tables
        for row in t.rows
    }
    treated = dict.fromkeys(refined.sync.mirrored, "mirrored")
    treated |= dict.fromkeys(refined.sync.excluded, "excluded")
    return check_facts(truth, result, ground, treated)
